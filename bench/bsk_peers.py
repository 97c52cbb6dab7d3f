"""Compares the speed of BSK-RL with that of Sparring's environments of tasking.

    make bench-peers BSK=1

Both sides run the same environments on one core, with random actions for all satellites that need one, every observation, and
a reset at each end of an episode. Turns alternate, so that both sides meet the same load of the machine, and the best turns are
compared. A satellite-second is a simulated second of one satellite.

The program also measures single environments from Python: the environment of `gymnasium.make`, and BSK-RL's classes in
`sparring.tasking`, which it builds by the same lines as BSK-RL's environment, with other imports.
"""

from __future__ import annotations

import argparse
import json
import math
import pathlib
import subprocess
import sys
import time
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from bsk_record.components import build_environment
from bsk_record.episodes.common import (
    ORBIT_S,
    SCANNING_TIME,
    UNIQUE_IMAGES,
    imager,
    resources_observed,
    scanner,
    stations_observed,
)
from bsk_record.specs import CommunicatorSpec, Episode, SatelliteSpec, component
from bsk_rl.sim import dyn
from bsk_rl.utils.orbital import walker_delta_args

#: Turns of each side.
TURNS = 3
#: Duration of a turn of BSK-RL, seconds.
BSK_SECONDS = 12.0
#: Duration of a turn of Sparring, seconds.
SPARRING_SECONDS = 3.0
#: Environments of Sparring's batch.
BATCH = 64
#: Settings of all environments.
RULES = {"max_step_duration": 600.0, "failure_penalty": -1.0, "terminate_on_time_limit": False}
#: Least ratios that the design asks for. BSK-RL's classes have none: their speed depends on the user's Python code.
GOALS = {"batch": 1000, "single": 250, "python": 100, "reset": 100}


class ScanningDynModel(dyn.ContinuousImagingDynModel, dyn.GroundStationDynModel):
    """Dynamics of the paper's scanning satellite, with the two angles that it observes."""

    @property
    def instrument_pointing_error(self) -> float:
        """Angle between the instrument and nadir, rad."""
        down = -self.r_BN_P / np.linalg.norm(self.r_BN_P)
        return float(np.arccos(np.dot(down, self.satellite.fsw.c_hat_P)))

    @property
    def solar_pointing_error(self) -> float:
        """Angle between the panel's normal and the Sun, rad."""
        sun = self.world.gravFactory.spiceObject.planetStateOutMsgs[self.world.sun_index].read().PositionVector
        normal = np.transpose(self.BN) @ self.satellite.sat_args["nHat_B"]
        return float(np.arccos(np.dot(normal, sun / np.linalg.norm(sun))))


# Satellites name their dynamics by a class of this module.
dyn.ScanningDynModel = ScanningDynModel


def scanning() -> Episode:
    """Returns the paper's environment, as `tasking/scanning`."""
    properties = [
        {"prop": "storage_level_fraction"},
        {"prop": "battery_charge_fraction"},
        {"prop": "wheel_speeds_fraction"},
        {"prop": "instrument_pointing_error", "norm": math.pi},
        {"prop": "solar_pointing_error", "norm": math.pi},
    ]
    observations = (
        component("SatProperties", properties=properties),
        stations_observed(),
        component("Eclipse", norm=ORBIT_S),
        component("Time"),
    )
    return Episode(
        name="scanning",
        seed=0,
        cls="SatelliteTasking",
        satellites=(scanner(observations=observations, dyn=("ScanningDynModel",)),),
        scenario=component("UniformNadirScanning", value_per_second=1 / (5 * ORBIT_S)),
        rewarders=SCANNING_TIME,
        policy=None,
        max_steps=0,
        env=RULES | {"time_limit": 5 * ORBIT_S},
    )


def agile_imager(name: str) -> SatelliteSpec:
    """Returns the satellite of `tasking/imaging`."""
    target = component(
        "OpportunityProperties",
        properties=[
            {"prop": "priority"},
            {"prop": "opportunity_open", "norm": ORBIT_S},
            {"prop": "opportunity_close", "norm": ORBIT_S},
            {"prop": "target_angle", "norm": math.pi},
        ],
        n_ahead_observe=10,
    )
    battery_ws = 200 * 3600
    image_bits = 8e6
    return imager(
        name,
        args={
            "batteryStorageCapacity": battery_ws,
            "storedCharge_Init": lambda: np.random.uniform(0.3, 1.0) * battery_ws,
            "dataStorageCapacity": 500 * image_bits,
            "instrumentBaudRate": image_bits,
            "transmitterBaudRate": -50 * image_bits,
            "basePowerDraw": -10.0,
            "instrumentPowerDraw": -30.0,
            "transmitterPowerDraw": -25.0,
            "thrusterPowerDraw": -80.0,
            "panelArea": 0.25,
            "maxWheelSpeed": 6000.0,
            "desatAttitude": "nadir",
        },
        actions=(
            component("Image", n_ahead_image=10),
            component("Charge", duration=120.0),
            component("Downlink", duration=60.0),
            component("Desat", duration=60.0),
        ),
        observations=(
            target,
            resources_observed(),
            component("Eclipse", norm=ORBIT_S),
            stations_observed(),
            component("Time"),
        ),
    )


def imaging() -> Episode:
    """Returns the environment `tasking/imaging`."""
    return Episode(
        name="imaging",
        seed=0,
        cls="SatelliteTasking",
        satellites=(agile_imager("Imager"),),
        scenario=component("UniformTargets", n_targets=1250),
        rewarders=UNIQUE_IMAGES,
        policy=None,
        max_steps=0,
        env=RULES | {"time_limit": 3 * ORBIT_S},
    )


def constellation() -> Episode:
    """Returns the environment `tasking/constellation`: three imagers of one plane."""
    return Episode(
        name="constellation",
        seed=0,
        cls="ConstellationTasking",
        satellites=tuple(agile_imager(f"Imager{index}") for index in range(1, 4)),
        scenario=component("UniformTargets", n_targets=1000),
        rewarders=UNIQUE_IMAGES,
        policy=None,
        max_steps=0,
        communicator=CommunicatorSpec(types=("LOSCommunication",)),
        orbits=walker_delta_args(altitude=800, inc=60, n_planes=1),
        env=RULES | {"time_limit": 2 * ORBIT_S},
    )


@dataclass
class Turn:
    """Speed in one turn."""

    #: Simulated satellite-seconds a second, resets included.
    speed: float
    #: Duration of a reset, seconds.
    reset_s: float
    #: Steps a second, resets included.
    steps: float
    #: Processor and instruction set, of turns of Sparring.
    machine: str = ""


class BskEnvironment:
    """Environment of BSK-RL's classes that goes on from turn to turn."""

    def __init__(self, episode: Episode) -> None:
        """Creates the environment; its first reset compiles and loads data, and is not measured."""
        self.episode, self.env = episode, build_environment(episode)
        self.seed = 0
        self.reset()

    def reset(self) -> float:
        """Begins an episode of a new seed; returns the seconds that it took."""
        self.seed += 1
        begun = time.perf_counter()
        self.env.reset(seed=self.seed)
        return time.perf_counter() - begun

    def actions(self) -> Any:
        """Returns a random action for each satellite that needs one."""
        if self.episode.cls != "ConstellationTasking":
            return self.env.action_space.sample()
        idle = (item.name for item in self.env.satellites if item.requires_retasking and item.name in self.env.agents)
        return {name: self.env.action_space(name).sample() for name in idle}

    def is_over(self, terminated: Any, truncated: Any) -> bool:
        """Returns whether the episode has ended."""
        if self.episode.cls != "ConstellationTasking":
            return bool(terminated or truncated)
        return not self.env.agents

    def turn(self, duration: float) -> Turn:
        """Steps the environment for a number of seconds."""
        satellites = len(self.episode.satellites)
        simulated = steps = 0.0
        resets: list[float] = []
        begun = time.perf_counter()
        # Every turn begins with a reset, and so has the share of resets of whole episodes on average.
        resets.append(self.reset())
        while time.perf_counter() - begun < duration:
            before = self.env.simulator.sim_time
            _, _, terminated, truncated, _ = self.env.step(self.actions())
            simulated += (self.env.simulator.sim_time - before) * satellites
            steps += 1
            if self.is_over(terminated, truncated):
                resets.append(self.reset())
        seconds = time.perf_counter() - begun
        return Turn(simulated / seconds, min(resets), steps / seconds)


class GymnasiumEnvironment:
    """Environment of `gymnasium.make` that goes on from turn to turn."""

    def __init__(self, episode: Episode) -> None:
        self.satellites, self.seed = len(episode.satellites), 0
        self.idle: Any = None
        params = {"satellites": self.satellites} if episode.cls == "ConstellationTasking" else {}
        self.env = gymnasium.make(f"sparring:sparring/{episode.name.capitalize()}-v0", params=params)
        self.reset()

    def reset(self) -> float:
        """Begins an episode of a new seed; returns the seconds that it took."""
        self.seed += 1
        begun = time.perf_counter()
        _, info = self.env.reset(seed=self.seed)
        self.idle = info["requires_retasking"]
        return time.perf_counter() - begun

    def turn(self, duration: float) -> Turn:
        """Steps the environment for a number of seconds; satellites that need no action go on."""
        simulated = steps = 0.0
        begun = time.perf_counter()
        resets = [self.reset()]
        while time.perf_counter() - begun < duration:
            actions = np.where(self.idle, self.env.action_space.sample(), -1)
            _, _, terminated, truncated, info = self.env.step(actions)
            self.idle = info["requires_retasking"]
            simulated += info["d_ts"] * self.satellites
            steps += 1
            if terminated or truncated:
                resets.append(self.reset())
        seconds = time.perf_counter() - begun
        return Turn(simulated / seconds, min(resets), steps / seconds)


def classes_turn(environment: str) -> Turn:
    """Steps the classes of `sparring.tasking` in another process, in which they have the names of BSK-RL."""
    program = pathlib.Path(__file__).with_name("bsk_classes.py")
    command = [sys.executable, str(program), environment, "--seconds", str(SPARRING_SECONDS)]
    output = subprocess.run(command, check=True, capture_output=True, text=True)
    return Turn(**json.loads(output.stdout))


def sparring_turn(bench: str, environment: str, envs: int) -> Turn:
    """Steps Sparring's environments for the duration of a turn."""
    command = [bench, "--tasking-turn", f"tasking/{environment}", "--turn-envs", str(envs)]
    command += ["--turn-seconds", str(SPARRING_SECONDS)]
    output = subprocess.run(command, check=True, capture_output=True, text=True)
    found = json.loads(output.stdout)
    machine = f"{found['cpu']}, {found['instruction_set']}"
    return Turn(found["satellite_seconds_per_s"], found["reset_s"], found["steps_per_s"], machine)


def compare(episode: Episode, bench: str) -> bool:
    """Prints the speeds and ratios of one environment; returns whether all goals are met."""
    peer, single = BskEnvironment(episode), GymnasiumEnvironment(episode)
    turns: dict[str, list[Turn]] = {side: [] for side in ("peer", "batch", "single", "python", "classes")}
    for number in range(TURNS):
        turns["peer"].append(peer.turn(BSK_SECONDS))
        turns["batch"].append(sparring_turn(bench, episode.name, BATCH))
        turns["single"].append(sparring_turn(bench, episode.name, 1))
        turns["python"].append(single.turn(SPARRING_SECONDS))
        turns["classes"].append(classes_turn(episode.name))
        print(f"{episode.name}: turn {number + 1} of {TURNS} is done", file=sys.stderr)
    speed = {side: max(turn.speed for turn in all_turns) for side, all_turns in turns.items()}
    steps = {side: max(turn.steps for turn in all_turns) for side, all_turns in turns.items()}
    reset = {side: min(turn.reset_s for turn in all_turns) for side, all_turns in turns.items()}
    print(f"\n{episode.name}: {len(episode.satellites)} satellites, one core of {turns['batch'][0].machine}")
    print(f"{'':24}{'ns a satellite-second':>24}{'steps/s':>12}{'reset':>12}")
    names = {
        "peer": "BSK-RL",
        "batch": f"Sparring, batch of {BATCH}",
        "single": "Sparring, one by one",
        "python": "gymnasium.make",
        "classes": "sparring.tasking",
    }
    for side, name in names.items():
        print(f"{name:24}{1e9 / speed[side]:24.1f}{steps[side]:12.0f}{reset[side] * 1e3:9.2f} ms")
    ratios = {side: speed[side] / speed["peer"] for side in ("batch", "single", "python", "classes")}
    ratios["reset"] = reset["peer"] / reset["single"]
    for name, ratio in ratios.items():
        print(f"ratio {name:10} {ratio:8.0f}" + (f" (goal: at least {GOALS[name]})" if name in GOALS else ""))
    return all(ratios[name] >= goal for name, goal in GOALS.items())


#: Environments by name.
ENVIRONMENTS = {"scanning": scanning, "imaging": imaging, "constellation": constellation}


def main() -> None:
    """Compares the environments that are named, or all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bench", required=True, help="path of Sparring's program `bench`")
    parser.add_argument("environments", nargs="*", choices=[[], *ENVIRONMENTS], help="environments to compare (default: all)")
    args = parser.parse_args()
    met = [compare(ENVIRONMENTS[name](), args.bench) for name in args.environments or ENVIRONMENTS]
    print("\nall goals are met" if all(met) else "\nsome goals are missed")
    print("`bench tasking` measures the goals without a counterpart in BSK-RL: audits, and the share of windows in an episode")


if __name__ == "__main__":
    main()
