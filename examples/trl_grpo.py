"""GRPO with TRL on Sparring's curriculum: the siblings of a group fly one scenario, here, and what they did goes to the server.

    pip install 'sparring[trl]'                 # TRL 1.16, transformers 5.24, peft 0.21 as it was run
    sparring serve &
    python examples/trl_grpo.py --model Qwen/Qwen3-0.6B --siblings 8 --groups 4 --steps 500 --lora
    python examples/trl_grpo.py --tiny --steps 2 # without a model hub: a random model that calls tools by heart

Without --url a server is started for as long as this runs. TensorBoard shows the curriculum's numbers: tensorboard --logdir grpo
"""
import argparse

import torch
from transformers import AutoModelForCausalLM, AutoTokenizer
from trl import GRPOConfig, GRPOTrainer

import sparring
import sparring.trl


def tiny(envs):
    """A model without a hub, and what it knows: to call the tools."""
    from tiny_model import call, teach, tiny

    pilot = envs()  # looked at for its tools alone
    tools = [pilot.fire_thrusters, pilot.hold, pilot.telemetry]
    burns = [call("fire_thrusters", satellite_id=n, delta_vx=0.1, delta_vy=-0.1) for n in range(3)]
    answers = [*burns, call("hold", steps=5), call("hold", steps=20), call("telemetry"), {"content": "Done."}]
    prompts = [sparring.trl.PROMPT]
    model, tokenizer = tiny(prompts, answers, tools)
    teach(model, tokenizer, prompts, answers, tools)
    return model, tokenizer


def load(args):
    """A model that calls tools."""
    tokenizer = AutoTokenizer.from_pretrained(args.model)
    return AutoModelForCausalLM.from_pretrained(args.model, dtype=torch.bfloat16), tokenizer


def train(curriculum, args):
    with sparring.trl.Environments(curriculum, args.siblings, reward=args.reward) as envs:
        model, tokenizer = tiny(envs) if args.tiny else load(args)
        peft = None
        if args.lora:
            from peft import LoraConfig

            peft = LoraConfig(r=16, lora_alpha=32, target_modules="all-linear", task_type="CAUSAL_LM")
        config = GRPOConfig(
            output_dir=args.output,
            use_cpu=not torch.cuda.is_available(),
            bf16=torch.cuda.is_available(),
            learning_rate=1e-5,
            max_steps=args.steps,
            num_generations=args.siblings,
            per_device_train_batch_size=args.siblings,
            gradient_accumulation_steps=args.groups,
            max_completion_length=args.tokens,
            chat_template_kwargs={"enable_thinking": False},
            use_vllm=args.vllm,
            vllm_max_model_length=2048 + args.tokens if args.vllm else None,
            logging_steps=1,
            report_to="tensorboard",
            save_steps=100,
        )
        trainer = GRPOTrainer(
            model=model,
            processing_class=tokenizer,
            args=config,
            train_dataset=envs.dataset(args.steps * args.groups),
            environment_factory=envs,
            peft_config=peft,
            callbacks=[sparring.trl.CurriculumCallback(envs)],
        )
        trainer.train()
        trainer.save_model()
        envs.flush()
        stats = envs.stats()
        print(f"{curriculum.run}: {stats['flown']} episodes flown, {stats['counted'] + stats['stored']} counted")
    for row in curriculum.mastery():
        level = "not placed yet" if row["level"] is None else f"level {row['level']}"
        print(f"{row['task']}: {level}, {row['plain']['episodes']} episodes, mean score {row['plain']['score']:.3f}")



def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", default="Qwen/Qwen3-0.6B", help="a model that calls tools, by name or folder")
    parser.add_argument("--tiny", action="store_true", help="a model made on the spot instead")
    parser.add_argument("--lora", action="store_true", help="train an adapter (needs peft): less memory")
    parser.add_argument("--vllm", action="store_true", help="generate by vLLM in this process (needs vllm and a GPU)")
    parser.add_argument("--steps", type=int, default=500, help="of the optimiser")
    parser.add_argument("--groups", type=int, default=1, help="scenarios of a step")
    parser.add_argument("--siblings", type=int, default=4, help="episodes of a scenario")
    parser.add_argument("--tokens", type=int, default=4096, help="of one episode, tools' answers included")
    parser.add_argument("--reward", choices=["score", "skill"], default="score")
    parser.add_argument("--url", help="a server that runs")
    parser.add_argument("--run", help="one of its runs; one is created otherwise")
    parser.add_argument("--tasks", nargs="+", default=["kessler/survival"], help="of a run that is created")
    parser.add_argument("--output", default="grpo", help="folder of checkpoints and curves")
    args = parser.parse_args()

    if args.siblings < 2 or min(args.steps, args.groups, args.tokens) < 1:
        parser.error("--siblings is 2 at least, --steps, --groups and --tokens are 1")
    settings = {"tasks": args.tasks, "group_size": args.siblings}
    try:
        curriculum = sparring.Curriculum.find(args.url, args.run, settings=settings)
    except (sparring.CurriculumError, ValueError) as error:
        parser.error(str(error))
    with curriculum:
        train(curriculum, args)


if __name__ == "__main__":
    main()
