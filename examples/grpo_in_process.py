"""GRPO with TRL and `sparring.trl`: episodes run in the trainer's process, and background threads report them to the server.

    pip install 'sparring[trl]'                 # tested with TRL 1.16, transformers 5.24, peft 0.21
    sparring serve &
    python examples/grpo_in_process.py --model Qwen/Qwen3-0.6B --group-size 8 --groups 4 --steps 500 --lora
    python examples/grpo_in_process.py --tiny --steps 2     # without a model hub: a tiny random model

Without --url a server is started for this training. TensorBoard shows the curriculum's metrics: tensorboard --logdir grpo
examples/grpo_openenv.py and examples/grpo_websocket.ipynb run the episodes on the server instead.
"""

import argparse

import torch
from transformers import AutoModelForCausalLM, AutoTokenizer
from trl import GRPOConfig, GRPOTrainer

import sparring
import sparring.trl


def make_tiny_model(envs):
    """Makes a tiny model that calls tools at random."""
    import tiny_model

    environment = envs()  # only its tools are used
    tools = [environment.fire_thrusters, environment.hold, environment.telemetry]
    call = tiny_model.tool_call
    answers = [call("fire_thrusters", satellite_id=n, delta_vx=0.1, delta_vy=-0.1) for n in range(3)]
    answers += [call("hold", steps=5), call("hold", steps=20), call("telemetry"), {"content": "Done."}]
    prompts = [sparring.trl.PROMPT]
    model, tokenizer = tiny_model.make_tiny_model(prompts, answers, tools)
    tiny_model.teach(model, tokenizer, prompts, answers, tools)
    return model, tokenizer


def load_model(args):
    """Loads a model that calls tools."""
    tokenizer = AutoTokenizer.from_pretrained(args.model)
    return AutoModelForCausalLM.from_pretrained(args.model, dtype=torch.bfloat16), tokenizer


def make_config(args):
    return GRPOConfig(
        output_dir=args.output,
        use_cpu=not torch.cuda.is_available(),
        bf16=torch.cuda.is_available(),
        learning_rate=1e-5,
        max_steps=args.steps,
        num_generations=args.group_size,
        per_device_train_batch_size=args.group_size,
        gradient_accumulation_steps=args.groups,
        max_completion_length=args.tokens,
        chat_template_kwargs={"enable_thinking": False},
        use_vllm=args.vllm,
        vllm_max_model_length=2048 + args.tokens if args.vllm else None,
        logging_steps=1,
        report_to="tensorboard",
        save_steps=100,
    )


def train(curriculum, args):
    with sparring.trl.EnvironmentFactory(curriculum, args.group_size, reward=args.reward) as envs:
        model, tokenizer = make_tiny_model(envs) if args.tiny else load_model(args)
        lora = None
        if args.lora:
            from peft import LoraConfig

            lora = LoraConfig(r=16, lora_alpha=32, target_modules="all-linear", task_type="CAUSAL_LM")
        config = make_config(args)
        trainer = GRPOTrainer(
            model=model,
            processing_class=tokenizer,
            args=config,
            train_dataset=envs.dataset(args.steps * args.groups * config.world_size),
            environment_factory=envs,
            peft_config=lora,
            callbacks=[sparring.trl.CurriculumCallback(envs)],
        )
        trainer.train()
        trainer.save_model()
        envs.flush()
        stats = envs.stats()
        print(f"{curriculum.run}: {stats['finished']} episodes finished, {stats['counted'] + stats['stored']} counted")
    for row in curriculum.mastery():
        level = "no level" if row["level"] is None else f"level {row['level']}"
        print(f"{row['task']}: {level}, {row['results']['episodes']} episodes, mean score {row['results']['score']:.3f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", default="Qwen/Qwen3-0.6B", help="name or folder of a model that calls tools (%(default)s)")
    parser.add_argument("--tiny", action="store_true", help="use a tiny random model")
    parser.add_argument("--lora", action="store_true", help="train an adapter, which takes less memory (needs peft)")
    parser.add_argument("--vllm", action="store_true", help="generate by vLLM in this process (needs vllm and a GPU)")
    parser.add_argument("--steps", type=int, default=500, help="optimiser steps (%(default)s)")
    parser.add_argument("--groups", type=int, default=1, help="scenarios per step (%(default)s)")
    parser.add_argument("--group-size", type=int, default=4, help="episodes per scenario (%(default)s)")
    parser.add_argument("--tokens", type=int, default=4096, help="tokens per episode, including tool results (%(default)s)")
    parser.add_argument("--reward", choices=["score", "skill"], default="score", help="reward of an episode (%(default)s)")
    parser.add_argument("--url", help="address of a running server (default: start one)")
    parser.add_argument("--run", help="id of a run of that server (default: create one)")
    parser.add_argument("--tasks", nargs="+", default=["kessler/survival"], help="tasks of the run to create")
    parser.add_argument("--output", default="grpo", help="folder for checkpoints and curves (%(default)s)")
    args = parser.parse_args()

    if args.group_size < 2 or min(args.steps, args.groups, args.tokens) < 1:
        parser.error("--group-size must be >= 2; --steps, --groups and --tokens must be >= 1")
    settings = {"tasks": args.tasks, "group_size": args.group_size}
    try:
        curriculum = sparring.Curriculum.open(args.url, args.run, settings=settings)
    except (sparring.CurriculumError, ValueError) as error:
        parser.error(str(error))
    with curriculum:
        train(curriculum, args)


if __name__ == "__main__":
    main()
