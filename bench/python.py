"""Measures the cost of stepping from Python, relative to the compiled batch, in alternating turns.

    make bench-python [KESSLER_ENV=path/to/kessler-env]

It compares:

- `make_vec` with 1 024 environments on one thread and arrays of the caller, and `sparring bench` without Python;
- `make_vec` with and without a curriculum, whose server uses the other cores. Cores share caches and power, so the second
  comparison has a program that keeps a core equally busy;
- `make_vec` of tasking with 64 environments on one thread, and `sparring bench` without Python;
- the public Python environment, if a copy of it is given.

Turns alternate in both orders, and medians are compared, since load on the machine disturbs both sides.
"""

import argparse
import functools
import json
import os
import pathlib
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

import gymnasium
import numpy as np
import sparring

sys.path.insert(0, str(pathlib.Path(__file__).parent))

#: Turns of each comparison.
TURNS = 20
#: Duration of a turn, seconds.
SECONDS = 0.5
#: Environments of tasking: an episode ends after milliseconds of a core, so that a turn has many.
TASKING_ENVS = 64
#: Turns of each comparison of tasking, and the duration of one, seconds.
TASKING_TURNS, TASKING_SECONDS = 8, 2.0
#: Tasks of tasking.
TASKING_TASKS = ("tasking/scanning", "tasking/imaging", "tasking/constellation")
#: Number of environments.
ENVS = 1024
#: Pieces of debris, as in `sparring bench`.
DEBRIS = 50.0
#: Maximum burn, as in `sparring bench`.
BURN = 0.05
#: Number of joint actions that are drawn in advance.
ACTIONS = 13


def draw_actions(envs) -> list:
    """Draws small burns of about half of the agents, or random choices of all."""
    rng = np.random.default_rng(0)
    if isinstance(envs.single_action_space, gymnasium.spaces.MultiDiscrete):
        return [rng.integers(0, envs.single_action_space.nvec, envs.action_space.shape) for _ in range(ACTIONS)]
    joint_actions = []
    for _ in range(ACTIONS):
        burns = rng.uniform(-BURN, BURN, envs.action_space.shape).astype(np.float32)
        burns[rng.random(burns.shape[:2]) < 0.5] = 0.0
        joint_actions.append(burns)
    return joint_actions


class Stepping:
    """Environments that are stepped in turns."""

    def __init__(self, num_envs: int = ENVS, seconds: float = SECONDS, **arguments) -> None:
        self.seconds = seconds
        self.envs = sparring.make_vec(num_envs=num_envs, autoreset_mode="same_step", threads=1, **arguments)
        self.actions = draw_actions(self.envs)
        flags = (np.zeros(num_envs, np.bool_), np.zeros(num_envs, np.bool_))
        self.out = (self.envs.empty_observations(), np.zeros(num_envs), *flags)
        self.envs.reset(seed=None if "curriculum" in arguments else 1, out=self.out[0])

    def turn(self) -> float:
        """Returns environment steps per second."""
        steps, started = 0, time.perf_counter()
        while time.perf_counter() - started < self.seconds:
            for _ in range(8):
                self.envs.step(self.actions[steps % ACTIONS], out=self.out)
                steps += 1
        return steps * self.envs.num_envs / (time.perf_counter() - started)


def run_compiled(binary: str, tracks: bool, env: str = "kessler", envs: int = ENVS, seconds: float = SECONDS) -> dict:
    """Runs `sparring bench`; returns its report."""
    command = [binary, "bench", "--env", env, "--envs", str(envs), "--seconds", str(seconds), "--json"]
    output = subprocess.run([*command, *(["--tracks"] if tracks else [])], check=True, capture_output=True, text=True)
    return json.loads(output.stdout)


def compiled_turn(binary: str, tracks: bool) -> float:
    """Returns environment steps per second of the compiled batch."""
    return run_compiled(binary, tracks)["single_thread_env_steps_per_s"]


def compiled_tasking_turn(binary: str, task: str) -> float:
    """Returns environment steps per second of the compiled batch of a task of tasking."""
    return run_compiled(binary, False, task, TASKING_ENVS, TASKING_SECONDS)["single_thread_env_steps_per_s"]


class Comparison(NamedTuple):
    """Median rates of two sides, and the median of the ratios of each turn."""

    first: float
    second: float
    ratio: float


def compare(first: Callable[[], float], second: Callable[[], float], turns: int = TURNS) -> Comparison:
    """Runs two sides in alternating turns."""
    rates = []
    for turn in range(turns):
        if turn % 2:
            second_rate, first_rate = second(), first()
        else:
            first_rate, second_rate = first(), second()
        rates.append((first_rate, second_rate))
    ratio = statistics.median(first_rate / second_rate for first_rate, second_rate in rates)
    return Comparison(statistics.median(pair[0] for pair in rates), statistics.median(pair[1] for pair in rates), ratio)


def print_result(name: str, rate: float, ratio: float | None = None, goal: str = "") -> None:
    """Prints a result in one line."""
    print(f"{name:<82} {rate:12,.0f} steps/s" + ("" if ratio is None else f"  {ratio:8.2f}  {goal}"), flush=True)


def compare_with_compiled(binary: str) -> float:
    """Compares `make_vec` with the compiled batch; returns its rate with telemetry."""
    rates = {}
    for observation in ("telemetry", "tracks"):
        stepping = Stepping(task="kessler/survival", params={"debris": DEBRIS}, observation=observation)
        tracks = observation == "tracks"
        compiled, python, ratio = compare(functools.partial(compiled_turn, binary, tracks), stepping.turn)
        stepping.envs.close()
        rates[observation] = python
        print_result(f"compiled batch of {ENVS}, {observation}, one thread", compiled)
        name = f"make_vec of {ENVS}, {observation}, one thread; slowdown factor"
        print_result(name, python, ratio, "goal: at most 1.3")
    return rates["telemetry"]


def compare_tasking_with_compiled(binary: str) -> None:
    """Compares `make_vec` with the compiled batch, for each task of tasking."""
    for task in TASKING_TASKS:
        stepping = Stepping(task=task, num_envs=TASKING_ENVS, seconds=TASKING_SECONDS)
        stepping.turn()  # episodes of all ages, as in the middle of a training
        compiled, python, ratio = compare(functools.partial(compiled_tasking_turn, binary, task), stepping.turn, TASKING_TURNS)
        stepping.envs.close()
        print_result(f"compiled batch of {TASKING_ENVS}, {task}, one thread", compiled)
        print_result(f"make_vec of {TASKING_ENVS}, {task}, one thread; slowdown factor", python, ratio, "goal: at most 1.3")


#: Program that keeps a core busy for a share of the time.
BUSY_PROGRAM = """
import sys, time
share = float(sys.argv[1])
while True:
    deadline = time.perf_counter() + 0.01 * share
    while time.perf_counter() < deadline:
        pass
    time.sleep(0.01 * (1 - share))
"""


class SteppingWithLoad:
    """Stepping while another core is as busy as a server was."""

    def __init__(self, stepping: Stepping, share: float) -> None:
        self.stepping, self.share = stepping, share

    def turn(self) -> float:
        """Returns environment steps per second."""
        busy = subprocess.Popen([sys.executable, "-c", BUSY_PROGRAM, str(self.share)])
        try:
            time.sleep(0.1)
            return self.stepping.turn()
        finally:
            busy.kill()
            busy.wait()


def cpu_seconds(pid: int) -> float | None:
    """Returns the CPU time of a process; None if the system does not report it."""
    try:
        fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    except OSError:
        return None
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def compare_with_curriculum(binary: str) -> None:
    """Compares the same task and params with and without a curriculum."""
    settings = {"tasks": ["kessler/survival"], "strategy": "fixed", "design": {"designer": "off"}}
    with sparring.Curriculum.local(binary=binary, settings=settings, form="columns") as curriculum:
        curricular = Stepping(curriculum=curriculum)
        plain = Stepping(task="kessler/survival")
        curricular.turn()  # fills the queue of leased episodes
        comparison = compare(plain.turn, curricular.turn)
        pid = curriculum._server._process.pid
        before = cpu_seconds(pid)
        curricular.turn()
        after = cpu_seconds(pid)
        share = None if before is None or after is None else min(0.95, (after - before) / SECONDS)
        loaded = None if share is None else compare(SteppingWithLoad(plain, share).turn, curricular.turn)
        curricular.envs.close()
        plain.envs.close()
        curriculum.flush()
        stats = curriculum.stats()
    print_result("make_vec, tracks, one thread, no curriculum", comparison.first)
    cost = 100 * (comparison.ratio - 1)
    print_result("make_vec, tracks, one thread, with a curriculum; cost in %", comparison.second, cost, "goal: below 5")
    if loaded is not None:
        name = f"the same, relative to no curriculum and a core that is {share:.0%} busy like the server's"
        print_result(name, loaded.second, 100 * (loaded.ratio - 1), "goal: below 5")
    print(f"  episodes finished {stats['finished']:,}, accepted {stats['accepted']:,}, refused {stats['refused']:,}")


def compare_with_original(path: str, ours: float) -> None:
    """Compares with the public Python environment."""
    import peers

    environment = peers.load(pathlib.Path(path).resolve())
    action = peers.action_type(environment)
    theirs = statistics.median(peers.python_turn(environment, action) for _ in range(TURNS))
    print_result("public Python environment, in-process; slowdown factor", theirs, ours / theirs, "goal: at least 300")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sparring", required=True, help="path of the sparring binary, a release build")
    parser.add_argument("--kessler-env", default="", help="folder with a copy of the public kessler-env")
    args = parser.parse_args()
    ours = compare_with_compiled(args.sparring)
    compare_tasking_with_compiled(args.sparring)
    compare_with_curriculum(args.sparring)
    if args.kessler_env:
        compare_with_original(args.kessler_env, ours)
    else:
        recorded = 1e6 / run_compiled(args.sparring, tracks=False)["python_env_us_per_step"]
        print_result(
            "public Python environment, recorded figure; slowdown factor",
            recorded,
            ours / recorded,
            "goal: at least 300",
        )
        print("The figure was recorded on another machine. To measure it: make bench-python KESSLER_ENV=path")


if __name__ == "__main__":
    main()
