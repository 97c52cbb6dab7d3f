"""GRPO with TRL on Sparring's curriculum: every prompt is a group of siblings that fly the same scenario.

    pip install trl torch openenv-core          # TRL 1.16, transformers 5.23, openenv-core 0.3.0 as it was run
    sparring serve &
    python examples/grpo_trl.py --model Qwen/Qwen3-0.6B --steps 100

The curriculum chooses what is flown (`run`), hands the same scenario to all siblings of a group (`group_id`), and is told how each
episode ended when its last step is taken. What a model leaves unflown is flown by holding: a short answer is no way out.
"""
import argparse
import json
import urllib.request

from openenv.core.generic_client import GenericEnvClient

ARGS = argparse.Namespace(url="http://127.0.0.1:8700", run="", siblings=4)
TASK = (
    "Keep three satellites out of the way of debris for 50 steps. Call fire where something comes near, hold where nothing does. "
    "A burn of 0.2 some steps before is enough; burn across the way it comes."
)


class Pilot:
    """One sibling. TRL makes as many as fly at once; public methods are the model's tools."""

    def __init__(self):
        self._env = GenericEnvClient(base_url=ARGS.url).sync()
        self._env.connect()
        self._told = None

    def reset(self, group_id: str, **_) -> str:
        """A new episode: siblings with one name get one scenario."""
        self._told = self._env.reset(run=ARGS.run, group_id=group_id, group_size=ARGS.siblings)
        return self._seen()

    def fire(self, satellite_id: int, delta_vx: float, delta_vy: float) -> str:
        """
        Burns, and lets one step pass.

        Args:
            satellite_id: Which satellite, 0 to 2.
            delta_vx: Change of its velocity in x, -1 to 1.
            delta_vy: Change of its velocity in y, -1 to 1.

        Returns:
            What is seen then.
        """
        burn = {"satellite_id": satellite_id, "delta_vx": delta_vx, "delta_vy": delta_vy}
        return self._step([burn], 1)

    def hold(self, steps: int) -> str:
        """
        Does nothing for some steps.

        Args:
            steps: How many, 1 to 50.

        Returns:
            What is seen then.
        """
        return self._step([], max(1, min(int(steps), 50)))

    def get_reward(self) -> float:
        """The score of the episode, flown to its end."""
        self._step([], 50)
        return self._told.observation["total_score"]

    def _step(self, burns, steps) -> str:
        for _ in range(steps):
            if self._told.done:
                return f"The episode is over. Score: {self._told.observation['total_score']:.3f}"
            self._told = self._env.step({"burns": burns})
        return self._seen()

    def _seen(self) -> str:
        """Each satellite with the two pieces of debris next to it: a model reads less than all of it."""
        seen, lines = self._told.observation, []
        for own in seen["satellites"]:
            if own["status"] != "active":
                continue
            to = lambda other: (other["x"] - own["x"], other["y"] - own["y"])
            near = sorted(seen["radar_debris"], key=lambda other: sum(d * d for d in to(other)))[:2]
            told = [
                "debris at ({:.1f}, {:.1f}), moving ({:.2f}, {:.2f})".format(
                    *to(other), other["vx"] - own["vx"], other["vy"] - own["vy"]
                )
                for other in near
            ]
            lines.append(f"Satellite {own['id']}, fuel {own['fuel']:.0f}: " + "; ".join(told))
        return "\n".join([*seen["critical_alerts"], *lines])


def create_run() -> str:
    """A run of the curriculum whose groups have as many siblings as GRPO compares."""
    wish = {"tasks": ["kessler/survival"], "group_size": ARGS.siblings}
    request = urllib.request.Request(
        ARGS.url + "/v1/runs", json.dumps(wish).encode(), {"Content-Type": "application/json"}
    )
    with urllib.request.urlopen(request) as answer:
        return json.load(answer)["id"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url", default=ARGS.url)
    parser.add_argument("--model", default="Qwen/Qwen3-0.6B", help="a model that calls tools, by name or folder")
    parser.add_argument("--steps", type=int, default=100, help="of the optimiser")
    parser.add_argument("--siblings", type=int, default=ARGS.siblings, help="episodes of one scenario")
    parser.add_argument("--tokens", type=int, default=512, help="of one episode, tools' answers included")
    parser.add_argument("--lora", action="store_true", help="train an adapter (needs peft): less memory")
    parser.parse_args(namespace=ARGS)
    ARGS.run = create_run()

    import torch
    from datasets import Dataset
    from transformers import AutoModelForCausalLM, AutoTokenizer
    from trl import GRPOConfig, GRPOTrainer

    tokenizer = AutoTokenizer.from_pretrained(ARGS.model)
    model = AutoModelForCausalLM.from_pretrained(ARGS.model, dtype="bfloat16")
    peft = None
    if ARGS.lora:
        from peft import LoraConfig

        peft = LoraConfig(r=8, target_modules=["q_proj", "v_proj"], task_type="CAUSAL_LM")
    prompts = [{"prompt": [{"role": "user", "content": TASK + "\n\n"}], "group_id": f"g{n}"} for n in range(ARGS.steps)]
    config = GRPOConfig(
        output_dir="grpo-sparring",
        use_cpu=not torch.cuda.is_available(),
        bf16=torch.cuda.is_available(),
        max_steps=ARGS.steps,
        num_train_epochs=1,
        per_device_train_batch_size=ARGS.siblings,
        num_generations=ARGS.siblings,
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
        environment_factory=Pilot,
        peft_config=peft,
    )
    trainer.train()
    with urllib.request.urlopen(f"{ARGS.url}/v1/runs/{ARGS.run}/episodes?limit=100") as answer:
        episodes = json.load(answer)["episodes"]
    scores = [episode["score"] for episode in episodes if episode.get("score") is not None]
    print(f"{ARGS.run}: {len(scores)} episodes were reported, mean score {sum(scores) / max(1, len(scores)):.3f}")


if __name__ == "__main__":
    main()
