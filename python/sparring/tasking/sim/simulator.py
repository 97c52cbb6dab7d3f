"""Simulator of one episode: the compiled simulation, its models and its events."""

from __future__ import annotations

import logging
from typing import Any

from ..._native import NativeTaskingEpisode
from ..unsupported import sentence
from .parameters import FixedAttribute
from .places import Place, number_targets
from .setup import setup_text

logger = logging.getLogger(__name__)

NANO = 1e9
#: Rounding of times, s.
_TOLERANCE_S = 1e-6


class Simulator:
    """Simulation of the satellites of an environment, made anew at each reset."""

    sim_rate = FixedAttribute()
    max_step_duration = FixedAttribute()
    time_limit = FixedAttribute()

    def __init__(
        self,
        satellites: list[Any],
        world_type: type,
        world_args: dict[str, Any],
        sim_rate: float = 1.0,
        max_step_duration: float = 600.0,
        time_limit: float = float("inf"),
        environment: dict[str, Any] | None = None,
    ) -> None:
        """Creates the models of the world and of the satellites.

        `sim_rate`, `max_step_duration` and `time_limit` are in seconds. `environment` has the
        other parts of the set-up: class, rewarders, communicator and the scenario's targets.
        """
        self.sim_rate = sim_rate
        self.satellites = satellites
        self.max_step_duration = max_step_duration
        self.time_limit = time_limit
        self.logger = logger
        self.environment = environment or {}
        self.sim_time = 0.0
        self.run_count = 0
        self.native: Any = None
        self._event_time: float | None = None
        self._event_count = 0
        self._setup = ""
        self.places: list[Place] = []
        self._are_targets_plain: bool | None = None
        self.world: Any = world_type(self, sim_rate, **world_args)
        self.fsw_list: dict[str, Any] = {}
        self.dynamics_list: dict[str, Any] = {}
        for index, satellite in enumerate(satellites):
            satellite.set_simulator(self, index)
            self.dynamics_list[satellite.name] = satellite.set_dynamics(sim_rate)
            self.fsw_list[satellite.name] = satellite.set_fsw(sim_rate)

    def finish_init(self) -> None:
        """Starts the compiled simulation, which computes the first access windows."""
        self._setup = setup_text(self)
        self.native = NativeTaskingEpisode(self._setup, True)

    def restart_if_changed(self) -> None:
        """Starts the compiled simulation again if its set-up has changed since, such as a target's place."""
        before = self._setup
        self._setup = setup_text(self)
        if self._setup != before:
            self.native = NativeTaskingEpisode(self._setup, True)

    def number_targets(self) -> None:
        """Numbers the targets of the satellites, and links them."""
        self.places = number_targets(self.satellites, self.environment.get("targets", []))
        self._are_targets_plain = None

    def are_targets_plain(self) -> bool:
        """Returns whether the simulation can observe all properties of the targets."""
        if self._are_targets_plain is None:
            self._are_targets_plain = all(place.is_plain() for place in self.places)
        return self._are_targets_plain

    def next_event_number(self) -> int:
        """Returns a number by which events of the same time are ordered."""
        self._event_count += 1
        return self._event_count

    @property
    def sim_time_ns(self) -> int:
        """Time of the simulation, ns."""
        return round(self.sim_time * NANO)

    @property
    def log_time(self) -> float:
        """Time of the event that is being logged, or the simulation time, s."""
        return self.sim_time if self._event_time is None else self._event_time

    def run(self) -> Any:
        """Runs the simulation until an event ends the step, and returns the native step."""
        native = self.native
        commands = [satellite.take_command() for satellite in self.satellites]
        self.run_count += 1
        start = self.sim_time
        step = native.step([action for action, _ in commands], [target for _, target in commands])
        journal = native.take_journal()
        end = native.time_s
        if journal:
            self._process(journal)
        self.sim_time = end
        if logger.isEnabledFor(logging.INFO):
            is_longest = end - start >= self.max_step_duration - _TOLERANCE_S
            if end < self.time_limit and is_longest:
                logger.info("Max step duration reached")
        return step

    def _process(self, journal: list[tuple[Any, ...]]) -> None:
        """Processes what happened to the satellites, each at its own time."""
        if len(journal) > 1:
            journal.sort(key=self._order)
        for kind, time, index, *rest in journal:
            self._event_time = time
            satellite = self.satellites[index]
            if kind == "windows":
                satellite.log_windows(*rest)
            elif kind == "imaged":
                satellite.on_imaged()
            elif kind in ("missed", "timed"):
                satellite.on_timed_end(kind == "missed")
        self._event_time = None

    def _order(self, entry: tuple[Any, ...]) -> tuple[float, int]:
        """Time and number of an event; those of the same time happen in the order in which they were set."""
        kind, time, index, *_ = entry
        return time, self.satellites[index].event_number(kind)

    def log_windows(self) -> None:
        """Logs the computations of access windows since the last call."""
        journal = self.native.take_journal()
        if journal:
            self._process(journal)

    def get_satellite(self, name: str) -> Any:
        """Returns the satellite of a name."""
        for satellite in self.satellites:
            if satellite.name == name:
                return satellite
        raise ValueError(f"Satellite with name '{name}' not found.")

    def __getattr__(self, name: str) -> Any:
        if name in ("eventMap", "TotalSim", "createNewEvent", "AddModelToTask", "CreateNewTask"):
            raise NotImplementedError(sentence(f"Basilisk's {name}", "events and modules of the simulation are built in"))
        raise AttributeError(f"'Simulator' object has no attribute {name!r}")
