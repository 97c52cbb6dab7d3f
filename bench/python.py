"""What stepping from Python costs beside the compiled batch alone, in turns, in one run.

    make bench-python [KESSLER_ENV=path/to/kessler-env]

`make_vec` steps 1 024 environments on one thread into arrays of its caller's, `sparring bench` the same environments without
Python; then `make_vec` with and without a curriculum, whose server has the other cores (cores share what they have, so the same
is measured beside a program that does nothing but keep them as busy); and, with a copy of it, the public Python environment.
Turns alternate, in one order and the other, and their medians are compared: a busy machine disturbs both.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
import sparring

sys.path.insert(0, str(pathlib.Path(__file__).parent))

TURNS = 20
SECONDS = 0.5
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


def compiled(binary: str, tracks: bool) -> dict:
    """The same without Python."""
    command = [binary, "bench", "--env", "kessler", "--envs", str(ENVS), "--seconds", str(SECONDS), "--json"]
    answer = subprocess.run([*command, *(["--tracks"] if tracks else [])], check=True, capture_output=True, text=True)
    return json.loads(answer.stdout)


def compiled_turn(binary: str, tracks: bool) -> float:
    """Environment steps a second of that."""
    return compiled(binary, tracks)["single_thread_env_steps_per_s"]


def in_turns(one: Callable[[], float], other: Callable[[], float]) -> tuple[float, float, float]:
    """The median rate of each, and the median of their ratios, turn by turn."""
    pairs = []
    for turn in range(TURNS):
        if turn % 2:
            second, first = other(), one()
        else:
            first, second = one(), other()
        pairs.append((first, second))
    ratio = statistics.median(first / second for first, second in pairs)
    return statistics.median(pair[0] for pair in pairs), statistics.median(pair[1] for pair in pairs), ratio


def show(what: str, rate: float, ratio: float | None = None, goal: str = "") -> None:
    """One line."""
    print(f"{what:<82} {rate:12,.0f} steps/s" + ("" if ratio is None else f"  {ratio:8.2f}  {goal}"), flush=True)


def beside_compiled(binary: str) -> float:
    """How much slower Python's are, by both kinds of observations; the rate of all that is observed."""
    rates = {}
    for observation in ("telemetry", "tracks"):
        stepping = Stepping(task="kessler/survival", params={"debris": DEBRIS}, observation=observation)
        alone, python, ratio = in_turns(lambda kind=observation: compiled_turn(binary, kind == "tracks"), stepping.turn)
        stepping.envs.close()
        rates[observation] = python
        show(f"compiled batch of {ENVS}, {observation}, one thread", alone)
        show(f"make_vec of {ENVS}, {observation}, one thread; how many times slower", python, ratio, "goal: at most 1.3")
    return rates["telemetry"]


#: Keeps a core busy for this share of the time.
BUSY = """
import sys, time
share = float(sys.argv[1])
while True:
    until = time.perf_counter() + 0.01 * share
    while time.perf_counter() < until:
        pass
    time.sleep(0.01 * (1 - share))
"""


class Beside:
    """Stepping beside a core that is as busy as a server was."""

    def __init__(self, stepping: Stepping, share: float) -> None:
        self.stepping, self.share = stepping, share

    def turn(self) -> float:
        busy = subprocess.Popen([sys.executable, "-c", BUSY, str(self.share)])
        try:
            time.sleep(0.1)
            return self.stepping.turn()
        finally:
            busy.kill()
            busy.wait()


def seconds_of(pid: int) -> float | None:
    """What a process has used of the processors; none where the system does not say."""
    try:
        told = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    except OSError:
        return None
    return (int(told[11]) + int(told[12])) / os.sysconf("SC_CLK_TCK")


def with_curriculum(binary: str) -> None:
    """What a curriculum costs: the same task at the same params, with a server beside it and without."""
    settings = {"tasks": ["kessler/survival"], "strategy": "fixed", "design": {"designer": "off"}}
    with sparring.Curriculum.local(binary=binary, settings=settings, form="columns") as curriculum:
        taught = Stepping(curriculum=curriculum)
        alone = Stepping(task="kessler/survival")
        taught.turn()  # what is fetched ahead is there from here on
        without, with_it, ratio = in_turns(alone.turn, taught.turn)
        pid = curriculum._server._process.pid
        before = seconds_of(pid)
        taught.turn()
        after = seconds_of(pid)
        share = None if before is None or after is None else min(0.95, (after - before) / SECONDS)
        own = None if share is None else in_turns(Beside(alone, share).turn, taught.turn)[2]
        taught.envs.close()
        alone.envs.close()
        curriculum.flush()
        told = curriculum.stats()
    show("make_vec, tracks, one thread, no curriculum", without)
    show("make_vec, tracks, one thread, with a curriculum; cost in %", with_it, 100 * (ratio - 1), "goal: below 5")
    if own is not None:
        what = f"the same, beside no curriculum and a core that is {share:.0%} busy, as the server's"
        show(what, with_it, 100 * (own - 1), "goal: below 5")
    print(f"  episodes flown {told['flown']:,}, accepted {told['accepted']:,}, refused {told['refused']:,}")


def beside_original(path: str, ours: float) -> None:
    """The public Python environment."""
    import peers

    environment = peers.load(pathlib.Path(path).resolve())
    action = peers.action_type(environment)
    theirs = statistics.median(peers.python_turn(environment, action) for _ in range(TURNS))
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
        recorded = 1e6 / compiled(args.sparring, tracks=False)["python_env_us_per_step"]
        show(
            "public Python environment, as it was recorded; how many times slower",
            recorded,
            ours / recorded,
            "goal: at least 300",
        )
        print("Without a copy of it that is another machine's figure: make bench-python KESSLER_ENV=path")


if __name__ == "__main__":
    main()
