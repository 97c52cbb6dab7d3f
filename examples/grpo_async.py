r"""Asynchronous GRPO with TRL and `sparring.trl`: a spawned process runs the episodes while the trainer computes.

    pip install 'sparring[trl]' 'trl[vllm]' sparring-server
    VLLM_SERVER_DEV_MODE=1 vllm serve Qwen/Qwen3-4B --weight-transfer-config '{"backend": "nccl"}' \
        --logprobs-mode processed_logprobs --max-model-len 16384 &
    sparring serve &
    CUDA_VISIBLE_DEVICES=1 python examples/grpo_async.py --url http://127.0.0.1:8700 --model Qwen/Qwen3-4B
    python examples/grpo_async.py --tiny --steps 2     # without vLLM, a GPU and a model hub: a tiny random model

The run has tasks of kessler; with --docking there is a second run with docking/single, and the trainer has an environment for
each. Without --url a server is started for this training.
"""

import argparse
import contextlib
import os

from trl.experimental.async_grpo import AsyncGRPOConfig, AsyncGRPOTrainer

import sparring
import sparring.trl


def make_tiny_model(envs, folder):
    """Saves a tiny model that calls tools at random; returns a generation server for it, and the trainer's other arguments."""
    import tiny_generation_server
    import tiny_model

    call = tiny_model.tool_call
    tools, answers = [], [{"content": "Done."}]
    for factory in envs.values():
        environment = factory()  # only its tools are used
        if factory.tools == "docking":
            tools += [environment.thrust, environment.coast]
            answers += [call("coast", seconds=300), call("thrust", deputy_id=0, thrust_x=0.1, thrust_y=0, thrust_z=0, seconds=9)]
        else:
            tools += [environment.fire_thrusters, environment.hold, environment.telemetry]
            answers += [call("fire_thrusters", satellite_id=n, delta_vx=0.1, delta_vy=-0.1) for n in range(3)]
            answers += [call("hold", steps=5), call("hold", steps=20)]
    prompts = [row["prompt"][0]["content"] for row in envs.dataset(1)]
    model, tokenizer = tiny_model.make_tiny_model(prompts, answers, tools)
    tiny_model.teach(model, tokenizer, prompts, answers, tools)
    model.save_pretrained(folder)
    tokenizer.save_pretrained(folder)
    tiny_generation_server.replace_gpu_parts()
    server = tiny_generation_server.GenerationServer(model, tokenizer)
    return server, {"processing_class": tokenizer, "weight_transfer": tiny_generation_server.WeightCopy(server)}


def make_config(args, generation_url):
    more = {}
    if args.tiny:
        # A fixed number of samples per step and few rollouts at once, so that it takes seconds.
        batches = {"token_budget": 0, "max_inflight_tasks": 2 * args.group_size}
        more = {"use_cpu": True, "bf16": False, "gradient_checkpointing": False, **batches}
    return AsyncGRPOConfig(
        output_dir=args.output,
        learning_rate=1e-5,
        max_steps=args.steps,
        num_generations=args.group_size,
        per_device_train_batch_size=args.group_size,
        gradient_accumulation_steps=args.groups,
        max_completion_length=args.tokens,
        max_tool_calling_iterations=args.calls,
        chat_template_kwargs={"enable_thinking": False},
        vllm_server_base_url=generation_url,
        report_to="tensorboard",
        save_steps=100,
        **more,
    )


def open_environments(stack, args):
    """Opens a run for each world; returns the environments by name."""
    tasks = {"kessler": args.tasks, **({"docking": ["docking/single"]} if args.docking else {})}
    factories, url = {}, args.url
    for name, names in tasks.items():
        settings = {"tasks": names, "group_size": args.group_size}
        curriculum = stack.enter_context(sparring.Curriculum.open(url, settings=settings))
        url = curriculum.url  # the second run is on the same server
        factories[name] = sparring.trl.EnvironmentFactory(curriculum, args.group_size)
    return stack.enter_context(sparring.trl.Environments(factories))


def train(args):
    with contextlib.ExitStack() as stack:
        envs = open_environments(stack, args)
        model, generation_url, more = args.model, args.vllm_url, {}
        if args.tiny:
            model = os.path.join(args.output, "tiny")
            server, more = make_tiny_model(envs, model)
            stack.callback(server.stop)
            generation_url = server.url
        trainer = AsyncGRPOTrainer(
            model=model,
            args=make_config(args, generation_url),
            train_dataset=envs.dataset(args.steps * args.groups),
            environment_factory=envs,
            callbacks=[sparring.trl.CurriculumCallback(envs)],
            **more,
        )
        trainer.train()
        trainer.save_model()
        for name, factory in envs.items():
            for row in factory.curriculum.mastery():
                level = "no level" if row["level"] is None else f"level {row['level']}"
                results = row["results"]
                print(f"{name}: {row['task']}: {level}, {results['episodes']} episodes, mean score {results['score']:.3f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", default="Qwen/Qwen3-4B", help="name or folder of a model that calls tools (%(default)s)")
    parser.add_argument("--vllm-url", default="http://localhost:8000", help="address of the vLLM server (%(default)s)")
    parser.add_argument("--tiny", action="store_true", help="use a tiny random model and a generation server for it")
    parser.add_argument("--docking", action="store_true", help="train on docking/single, too")
    parser.add_argument("--steps", type=int, default=500, help="optimiser steps (%(default)s)")
    parser.add_argument("--groups", type=int, default=1, help="scenarios per step (%(default)s)")
    parser.add_argument("--group-size", type=int, default=8, help="episodes per scenario (%(default)s)")
    parser.add_argument("--tokens", type=int, default=1024, help="tokens per answer (%(default)s)")
    parser.add_argument("--calls", type=int, default=20, help="tool calls per episode (%(default)s)")
    parser.add_argument("--url", help="address of a running Sparring server (default: start one)")
    parser.add_argument("--tasks", nargs="+", default=["kessler/survival"], help="tasks of kessler (%(default)s)")
    parser.add_argument("--output", default="grpo-async", help="folder for checkpoints and curves (%(default)s)")
    args = parser.parse_args()

    if args.group_size < 2 or min(args.steps, args.groups, args.tokens, args.calls) < 1:
        parser.error("--group-size must be >= 2; --steps, --groups, --tokens and --calls must be >= 1")
    try:
        train(args)
    except sparring.CurriculumError as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
