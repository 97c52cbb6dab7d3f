"""Satellite that knows when it has access to places on the ground."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from ..unsupported import sentence
from ..utils.errors import no_opportunity
from .satellite import Satellite

Opportunity = dict[str, Any]
Filter = Callable[[Opportunity], bool]

#: Kinds of opportunities that the simulation searches.
KINDS = ("target", "ground_station")
#: Windows that close less than this after the current time have closed, s.
_CLOSED_S = 1e-12
_MAX_LOOKAHEAD = 100
#: Largest number of opportunities for which the simulation is asked at once.
MAX_FOUND = 10_000


class AccessSatellite(Satellite):
    """Satellite with access windows to targets and ground stations."""

    native_type = "AccessSatellite"

    def __init__(
        self,
        *args: Any,
        generation_duration: float = 600.0,
        initial_generation_duration: float | None = None,
        max_generation_duration_beyond_initial: float | None = float("inf"),
        **kwargs: Any,
    ) -> None:
        """Creates a satellite that computes access windows in blocks.

        Blocks have `generation_duration` seconds. A reset computes windows for
        `initial_generation_duration` seconds, by default the time limit, or none if it is
        infinite. At most `max_generation_duration_beyond_initial` seconds are added to these.
        """
        super().__init__(*args, **kwargs)
        self.generation_duration = generation_duration
        self.initial_generation_duration = initial_generation_duration
        self.max_generation_duration_beyond_initial = max_generation_duration_beyond_initial
        self.access_filter_functions: list[Filter] = []
        #: Filter of a rewarder, which the simulation applies itself.
        self.knowledge_filter: Filter | None = None
        #: Whether the satellite can have access to all targets of the simulation.
        self.has_all_targets = True

    def generation_times(self) -> dict[str, Any]:
        """Returns the times for which access windows are computed."""
        return {
            "generation_duration": self.generation_duration,
            "initial_generation_duration": self.initial_generation_duration,
            "max_generation_duration_beyond_initial": self.max_generation_duration_beyond_initial,
        }

    def reset_overwrite_previous(self) -> None:
        """Forgets the locations of the previous episode."""
        super().reset_overwrite_previous()
        self.locations_for_access_checking: list[dict[str, Any]] = []
        self._things: dict[str, dict[int, tuple[Any, Any]]] = {kind: {} for kind in KINDS}
        self._targets: dict[int, int] = {}
        self._is_started = False

    def add_location_for_access_checking(
        self, object: Any, r_LP_P: Any, min_elev: float, type: str, start_time: float = 0.0
    ) -> None:
        """Adds a location, planet-fixed in m, to the search for access windows.

        Targets and the world's ground stations are searched, from the start of the episode.
        """
        if type not in KINDS:
            raise NotImplementedError(f"Opportunities of type {type!r} are not supported; add targets to the scenario.")
        if self._is_started:
            raise NotImplementedError(sentence("A location that is added after the start", "add all of them in a reset"))
        location = {"object": object, type: object, "r_LP_P": r_LP_P, "min_elev": min_elev}
        location |= {"type": type, "start_time": start_time}
        self.locations_for_access_checking.append(location)
        if type == "ground_station":
            stations = self._things[type]
            stations[len(stations)] = (object, r_LP_P)

    def link_targets(self, own: list[int], numbers: dict[int, int], things: dict[int, tuple[Any, Any]]) -> None:
        """Links the satellite's own targets, given by their identities, to their numbers in the simulation.

        `numbers` and `things` are those of all targets: by identity, and object and position by number.
        """
        if len(set(own)) != len(own):
            raise NotImplementedError(sentence("A target that is added twice", "add it once"))
        self.has_all_targets = len(own) == len(numbers)
        self._targets = numbers if self.has_all_targets else {identity: numbers[identity] for identity in own}
        self._things["target"] = things if self.has_all_targets else {number: things[number] for number in self._targets.values()}

    def target_number(self, target: Any) -> int:
        """Returns the number of a target in the simulation."""
        number = self._targets.get(id(target))
        if number is None:
            raise ValueError(f"{target} is not a target of the satellite.")
        if self._things["target"][number][1] is not target.r_LP_P:
            raise NotImplementedError(sentence("A target that moves in an episode", "place targets in a reset"))
        return number

    def reset_post_sim_init(self) -> None:
        """Logs the first search for windows, and sets the access filter of the simulation."""
        super().reset_post_sim_init()
        if self.initial_generation_duration is None:
            limit = self.simulator.time_limit
            self.initial_generation_duration = 0 if limit == float("inf") else limit
        self._is_started = True
        self._link_filter()
        if self.initial_generation_duration > 0:
            self.log_windows(0.0, self.window_calculation_time)

    def _link_filter(self) -> None:
        """Sets the filter of the simulation to the functions that the user added."""
        functions = self.access_filter_functions
        if not functions and self.has_all_targets:
            return
        things = self._things

        def accepts(kind: str, number: int, open_s: float, close_s: float) -> bool:
            if number not in things[kind]:
                return False
            item = self._opportunity(kind, number, open_s, close_s)
            return all(function(item) for function in functions)

        self.simulator.native.set_access_filter(self.index, accepts)

    @property
    def window_calculation_time(self) -> float:
        """Time up to which windows are computed, s."""
        time: float = self.simulator.native.opportunities_until(self.index)
        return time

    def calculate_additional_windows(self, duration: float) -> None:
        """Computes windows for `duration` seconds more, to the end of a block, in one search."""
        if duration <= 0:
            return
        self.simulator.native.compute_opportunities(self.index, duration)
        self.simulator.log_windows()

    def log_windows(self, start_s: float, end_s: float) -> None:
        """Logs that windows were computed from and to a time, s."""
        self.logger.info(f"Finding opportunity windows from {start_s:.2f} to {end_s:.2f} seconds")

    def _opportunity(self, kind: str, number: int, open_s: float, close_s: float) -> Opportunity:
        """Opportunity of a window, as users of BSK-RL know it."""
        thing, place = self._things[kind][number]
        window = (self._window_end(open_s), self._window_end(close_s))
        return {"object": thing, "window": window, "type": kind, "r_LP_P": place}

    def _window_end(self, time_s: float) -> float:
        """Opening or close of a window; one at the end of a search has numpy's type, as in BSK-RL."""
        return np.float64(time_s) if time_s % self.generation_duration == 0.0 else time_s

    @property
    def opportunities(self) -> list[Opportunity]:
        """All opportunities that are computed, in the order of their close."""
        found = self.simulator.native.opportunities(self.index)
        return [self._opportunity(*item) for item in found if item[1] in self._things[item[0]]]

    @property
    def upcoming_opportunities(self) -> list[Opportunity]:
        """Opportunities that have not closed, in the order of their close."""
        now = self.simulator.sim_time + _CLOSED_S
        found = self.simulator.native.opportunities(self.index)
        things = self._things
        return [self._opportunity(*item) for item in found if item[3] >= now and item[1] in things[item[0]]]

    def opportunities_dict(
        self, types: Any = None, filter: Filter | list[Any] | None = None
    ) -> dict[Any, list[tuple[float, float]]]:
        """Returns the windows of each object, without those that the filter rejects.

        A list as filter holds objects to leave out; None is the default filter.
        """
        return self._windows(self.opportunities, types, filter)

    def upcoming_opportunities_dict(
        self, types: Any = None, filter: Filter | list[Any] | None = None
    ) -> dict[Any, list[tuple[float, float]]]:
        """Returns the windows of each object that have not closed."""
        return self._windows(self.upcoming_opportunities, types, filter)

    def next_opportunities_dict(
        self,
        types: Any = None,
        filter: Filter | list[Any] | None = None,
        min_needed: int | None = None,
    ) -> dict[Any, tuple[float, float]]:
        """Returns the next window of each object, of at least `min_needed` objects if given."""
        found: dict[Any, tuple[float, float]] = {}
        for item in self._selected(self.upcoming_opportunities, types, filter):
            found.setdefault(item["object"], item["window"])
            if min_needed is not None and len(found) >= min_needed:
                break
        return found

    def _windows(
        self, items: list[Opportunity], types: Any, filter: Filter | list[Any] | None
    ) -> dict[Any, list[tuple[float, float]]]:
        """Windows of each object among opportunities."""
        windows: dict[Any, list[tuple[float, float]]] = {}
        for item in self._selected(items, types, filter):
            windows.setdefault(item["object"], []).append(item["window"])
        return windows

    def _selected(self, items: list[Opportunity], types: Any, filter: Filter | list[Any] | None) -> Iterable[Opportunity]:
        """Opportunities of types that a filter accepts."""
        types = [types] if isinstance(types, str) else types
        accepts = self.default_access_filter
        if isinstance(filter, list):
            left_out = filter
            accepts = lambda item: item["object"] not in left_out  # noqa: E731
        elif filter is not None:
            accepts = filter
        return (item for item in items if (types is None or item["type"] in types) and accepts(item))

    def find_next_opportunities(
        self,
        n: int,
        pad: bool = True,
        max_lookahead: int = _MAX_LOOKAHEAD,
        types: Any = None,
        filter: Filter | list[Any] | None = None,
    ) -> list[Opportunity]:
        """Returns the next `n` opportunities in the order of their close.

        Fewer are padded with the last one if `pad`. At most `max_lookahead` blocks are searched.
        """
        if n == 0:
            return []
        if isinstance(types, (list, tuple)) and len(types) == 1:
            types = types[0]
        is_usual = filter is None and types in KINDS and max_lookahead == _MAX_LOOKAHEAD and pad
        if is_usual and is_integer(n) and 0 < n <= MAX_FOUND:
            return self._find_native(types, n)
        found: list[Opportunity] = []
        for _ in range(max_lookahead):
            found = []
            for item in self._selected(self.upcoming_opportunities, types, filter):
                found.append(item)
                if len(found) >= n:
                    return found
            initial = self.initial_generation_duration or 0
            beyond = self.max_generation_duration_beyond_initial
            limit = initial + (float("inf") if beyond is None else beyond)
            if self.window_calculation_time >= limit:
                break
            self.calculate_additional_windows(self.generation_duration)
        if not (pad and found):
            raise no_opportunity()
        self._log_padding(len(found), n)
        return found + [found[-1]] * (n - len(found))

    def _find_native(self, kind: str, n: int) -> list[Opportunity]:
        """The next `n` opportunities of a kind under the default filter."""
        native = self.simulator.native
        try:
            found = native.next_opportunities(self.index, kind, int(n))
        except ValueError as error:
            self.simulator.log_windows()
            raise no_opportunity(error) from error
        self.simulator.log_windows()
        first = found.index(found[-1]) + 1
        items = [self._opportunity(*item) for item in found[:first]]
        if first < n:
            self._log_padding(first, n)
            items += [items[-1]] * (n - first)
        return items

    def _log_padding(self, found: int, wanted: int) -> None:
        """Logs that fewer opportunities were found than wanted."""
        self.logger.info(f"Only {found} opportunities found, padding to {wanted}.")

    def get_access_filter(self) -> Any:
        """Raises the error of a function that BSK-RL removed."""
        raise DeprecationWarning("get_access_filter is deprecated. Use add_access_filter and default_access_filter instead.")

    def add_access_filter(self, access_filter_fn: Filter, types: Any = None, prepend: bool = False) -> None:
        """Adds a function that accepts opportunities, of all or some types.

        Observations and actions use opportunities that all functions accept.
        """
        function = access_filter_fn
        if types is not None:
            limited = [types] if isinstance(types, str) else types

            def function(opportunity: Opportunity) -> bool:
                return opportunity["type"] not in limited or access_filter_fn(opportunity)

        if prepend:
            self.access_filter_functions.insert(0, function)
        else:
            self.access_filter_functions.append(function)
        if getattr(self, "_is_started", False):
            self._link_filter()

    @property
    def default_access_filter(self) -> Filter:
        """Function that accepts an opportunity if all filters do."""

        def accepts(opportunity: Opportunity) -> bool:
            knowledge = self.knowledge_filter
            return all(function(opportunity) for function in self.access_filter_functions) and (
                knowledge is None or knowledge(opportunity)
            )

        return accepts


def is_integer(value: Any) -> bool:
    """Returns whether a value has an integer type."""
    return bool(np.issubdtype(type(value), np.integer))
