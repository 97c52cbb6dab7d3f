"""GRPO with TRL and OpenEnv's client: episodes run on the server, and the trainer steps them over a WebSocket of OpenEnv.

    pip install trl torch peft openenv     # tested with TRL 1.16, transformers 5.24, openenv 0.10.0
    sparring serve &
    python examples/grpo_openenv.py --model Qwen/Qwen3-0.6B --steps 100

A prompt is a group of episodes of one scenario. The curriculum of the run (`run`) chooses the scenarios, and assigns the same one
to all members of a group (`group_id`). It receives the outcome of an episode with its last step. The environment holds for the
steps that a model leaves unused, so that a short answer has no advantage. examples/grpo_in_process.py runs the episodes in the
trainer's process instead.
"""

import argparse
import json
import urllib.request

from openenv.core.generic_client import GenericEnvClient

ARGS = argparse.Namespace(url="http://127.0.0.1:8700", run="", group_size=4)
PROMPT = (
    "Keep three satellites out of the way of debris for 50 steps. Call fire where something comes near, hold where nothing does. "
    "A burn of 0.2 some steps before is enough; burn across the way it comes."
)
# Steps of an episode.
HORIZON = 50
# Pieces of debris that are described per satellite.
MAX_DEBRIS = 2


class ToolEnvironment:
    """Environment of one member of a group. Its public methods are the tools of the model."""

    def __init__(self):
        self._env = GenericEnvClient(base_url=ARGS.url).sync()
        self._env.connect()
        self._result = None

    def reset(self, group_id: str, **_) -> str:
        """Begins an episode of the scenario that all members with this `group_id` share."""
        self._result = self._env.reset(run=ARGS.run, group_id=group_id, group_size=ARGS.group_size)
        return self._describe()

    def fire(self, satellite_id: int, delta_vx: float, delta_vy: float) -> str:
        """
        Burns, and lets one step pass.

        Args:
            satellite_id: Number of the satellite, 0 to 2.
            delta_vx: Change of its velocity in x, -1 to 1.
            delta_vy: Change of its velocity in y, -1 to 1.

        Returns:
            The observation after the last step.
        """
        burn = {"satellite_id": satellite_id, "delta_vx": delta_vx, "delta_vy": delta_vy}
        return self._step([burn], 1)

    def hold(self, steps: int) -> str:
        """
        Does nothing for some steps.

        Args:
            steps: Number of steps, 1 to 50.

        Returns:
            The observation after the last step.
        """
        return self._step([], max(1, min(int(steps), HORIZON)))

    def get_reward(self) -> float:
        """Holds for the remaining steps and returns the score of the episode."""
        self._step([], HORIZON)
        return self._result.observation["total_score"]

    def _step(self, burns, steps) -> str:
        for _ in range(steps):
            if self._result.done:
                return f"The episode is over. Score: {self._result.observation['total_score']:.3f}"
            self._result = self._env.step({"burns": burns})
        return self._describe()

    def _describe(self) -> str:
        """Describes each satellite with the nearest debris, which is shorter than the whole observation."""
        observation, lines = self._result.observation, []
        for satellite in observation["satellites"]:
            if satellite["status"] != "active":
                continue
            debris = sorted(observation["radar_debris"], key=lambda body: squared_distance(satellite, body))[:MAX_DEBRIS]
            described = "; ".join(describe_relative(satellite, body) for body in debris)
            lines.append(f"Satellite {satellite['id']}, fuel {satellite['fuel']:.0f}: " + described)
        return "\n".join([*observation["critical_alerts"], *lines])


def squared_distance(a, b):
    return (b["x"] - a["x"]) ** 2 + (b["y"] - a["y"]) ** 2


def describe_relative(satellite, body):
    """Describes the position and velocity of a body relative to a satellite."""
    x, y, vx, vy = (body[name] - satellite[name] for name in ("x", "y", "vx", "vy"))
    return f"debris at ({x:.1f}, {y:.1f}), moving ({vx:.2f}, {vy:.2f})"


def create_run() -> str:
    """Creates a run with the group size of GRPO; returns its id."""
    settings = {"tasks": ["kessler/survival"], "group_size": ARGS.group_size}
    headers = {"Content-Type": "application/json"}
    request = urllib.request.Request(ARGS.url + "/v1/runs", json.dumps(settings).encode(), headers)
    with urllib.request.urlopen(request) as response:
        return json.load(response)["id"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url", default=ARGS.url, help="address of the server (%(default)s)")
    parser.add_argument("--model", default="Qwen/Qwen3-0.6B", help="name or folder of a model that calls tools (%(default)s)")
    parser.add_argument("--steps", type=int, default=100, help="optimiser steps (%(default)s)")
    parser.add_argument("--group-size", type=int, default=ARGS.group_size, help="episodes per scenario (%(default)s)")
    parser.add_argument("--tokens", type=int, default=512, help="tokens per episode, including tool results (%(default)s)")
    parser.add_argument("--lora", action="store_true", help="train an adapter, which takes less memory (needs peft)")
    parser.parse_args(namespace=ARGS)
    ARGS.run = create_run()

    import torch
    from datasets import Dataset
    from transformers import AutoModelForCausalLM, AutoTokenizer
    from trl import GRPOConfig, GRPOTrainer

    tokenizer = AutoTokenizer.from_pretrained(ARGS.model)
    model = AutoModelForCausalLM.from_pretrained(ARGS.model, dtype="bfloat16")
    lora = None
    if ARGS.lora:
        from peft import LoraConfig

        lora = LoraConfig(r=8, target_modules=["q_proj", "v_proj"], task_type="CAUSAL_LM")
    message = {"role": "user", "content": PROMPT + "\n\n"}
    prompts = [{"prompt": [message], "group_id": f"g{number}"} for number in range(ARGS.steps)]
    config = GRPOConfig(
        output_dir="grpo-sparring",
        use_cpu=not torch.cuda.is_available(),
        bf16=torch.cuda.is_available(),
        max_steps=ARGS.steps,
        num_train_epochs=1,
        per_device_train_batch_size=ARGS.group_size,
        num_generations=ARGS.group_size,
        max_completion_length=ARGS.tokens,
        logging_steps=1,
        report_to="none",
        save_strategy="no",
    )
    trainer = GRPOTrainer(
        model=model,
        processing_class=tokenizer,
        args=config,
        train_dataset=Dataset.from_list(prompts),
        environment_factory=ToolEnvironment,
        peft_config=lora,
    )
    trainer.train()
    with urllib.request.urlopen(f"{ARGS.url}/v1/runs/{ARGS.run}/episodes?limit=100") as response:
        episodes = json.load(response)["episodes"]
    scores = [episode["score"] for episode in episodes if episode.get("score") is not None]
    print(f"{ARGS.run}: {len(scores)} episodes were reported, mean score {sum(scores) / max(1, len(scores)):.3f}")


if __name__ == "__main__":
    main()
