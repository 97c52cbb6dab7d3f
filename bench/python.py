"""What stepping from Python costs beside the compiled batch alone, in turns, in one run.

    make bench-python [KESSLER_ENV=path/to/kessler-env]

`make_vec` steps 1 024 environments on one thread into arrays of its caller's, `sparring bench` the same environments without
Python; then `make_vec` with and without a curriculum, whose server has the other cores; and, with a copy of it, the public Python
environment. Turns alternate, and the best of each is compared: what disturbs a machine only ever slows it down.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import time

import numpy as np

import sparring

sys.path.insert(0, str(pathlib.Path(__file__).parent))

TURNS = 5
SECONDS = 2.0
ENVS = 1024
#: As `sparring bench` flies kessler.
DEBRIS = 50.0
SIZE = 0.05
#: Joint actions drawn beforehand.
ACTIONS = 13


def actions_of(envs) -> list:
    """Small burns by about half of the agents."""
    rng = np.random.default_rng(0)
    drawn = []
    for _ in range(ACTIONS):
        burns = rng.uniform(-SIZE, SIZE, envs.action_space.shape).astype(np.float32)
        burns[rng.random(burns.shape[:2]) < 0.5] = 0.0
        drawn.append(burns)
    return drawn


class Stepping:
    """Environments that were made once and are stepped in turns."""

    def __init__(self, **wish) -> None:
        self.envs = sparring.make_vec(num_envs=ENVS, autoreset_mode="same_step", threads=1, **wish)
        self.actions = actions_of(self.envs)
        flags = (np.zeros(ENVS, np.bool_), np.zeros(ENVS, np.bool_))
        self.out = (self.envs.empty(), np.zeros(ENVS), *flags)
        self.envs.reset(seed=None if "curriculum" in wish else 1, out=self.out[0])

    def turn(self) -> float:
        """Environment steps a second."""
        steps, begun = 0, time.perf_counter()
        while time.perf_counter() - begun < SECONDS:
            for _ in range(8):
                self.envs.step(self.actions[steps % ACTIONS], out=self.out)
                steps += 1
        return steps * ENVS / (time.perf_counter() - begun)


def compiled_turn(binary: str, tracks: bool) -> float:
    """The same without Python."""
    command = [binary, "bench", "--env", "kessler", "--envs", str(ENVS), "--seconds", str(SECONDS), "--json"]
    answer = subprocess.run([*command, *(["--tracks"] if tracks else [])], check=True, capture_output=True, text=True)
    return json.loads(answer.stdout)["single_thread_env_steps_per_s"]


def show(what: str, rate: float, ratio: float | None = None, goal: str = "") -> None:
    """One line."""
    print(f"{what:<72} {rate:12,.0f} steps/s" + ("" if ratio is None else f"  {ratio:8.2f}  {goal}"), flush=True)


def beside_compiled(binary: str) -> float:
    """How much slower Python's are, by both kinds of observations; the rate of all that is observed."""
    rates = {}
    for observation in ("telemetry", "tracks"):
        stepping = Stepping(task="kessler/survival", params={"debris": DEBRIS}, observation=observation)
        compiled, python = [], []
        for _ in range(TURNS):
            compiled.append(compiled_turn(binary, observation == "tracks"))
            python.append(stepping.turn())
        stepping.envs.close()
        rates[observation] = max(python)
        show(f"compiled batch of {ENVS}, {observation}, one thread", max(compiled))
        ratio = max(compiled) / max(python)
        show(f"make_vec of {ENVS}, {observation}, one thread; how many times slower", max(python), ratio, "goal: at most 1.3")
    return rates["telemetry"]


def with_curriculum(binary: str) -> None:
    """What a curriculum costs: the same task at the same params, with a server beside it and without."""
    settings = {"tasks": ["kessler/survival"], "strategy": "fixed", "design": {"designer": "off"}}
    with sparring.Curriculum.local(binary=binary, settings=settings, form="columns") as curriculum:
        taught = Stepping(curriculum=curriculum)
        alone = Stepping(task="kessler/survival")
        taught.turn()  # what is fetched ahead is there from here on
        rates = {"alone": [], "taught": []}
        for _ in range(TURNS):
            rates["alone"].append(alone.turn())
            rates["taught"].append(taught.turn())
        taught.envs.close()
        alone.envs.close()
        curriculum.flush()
        told = curriculum.stats()
    show("make_vec, tracks, one thread, no curriculum", max(rates["alone"]))
    cost = 100 * (max(rates["alone"]) / max(rates["taught"]) - 1)
    show("make_vec, tracks, one thread, with a curriculum; cost in %", max(rates["taught"]), cost, "goal: below 5")
    print(f"  episodes flown {told['flown']:,}, accepted {told['accepted']:,}, refused {told['refused']:,}, late {told['late']:,}")


def beside_original(path: str, ours: float) -> None:
    """The public Python environment."""
    import peers

    environment = peers.load(pathlib.Path(path).resolve())
    action = peers.action_type(environment)
    theirs = max(peers.python_turn(environment, action) for _ in range(TURNS))
    show("public Python environment, in-process; how many times slower", theirs, ours / theirs, "goal: at least 300")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sparring", required=True, help="the sparring binary, built in release")
    parser.add_argument("--kessler-env", default="", help="a copy of the public kessler-env")
    args = parser.parse_args()
    ours = beside_compiled(args.sparring)
    with_curriculum(args.sparring)
    if args.kessler_env:
        beside_original(args.kessler_env, ours)
    else:
        print("No copy of the public kessler-env was given, so it is not measured: make bench-python KESSLER_ENV=path")


if __name__ == "__main__":
    main()
