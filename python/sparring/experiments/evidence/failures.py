"""Failure modes of held-out episodes, and those at which designed layouts aim."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import sparring

from .held_out import RecordedEpisode

#: Largest number of designs on a page of the server.
PAGE = 500


def failure_shares(episodes: Sequence[RecordedEpisode]) -> dict[str, float]:
    """Returns the share of episodes that have at least one failure of each mode, by the critique of their action logs."""
    modes: Counter[str] = Counter()
    for scenario, actions in episodes:
        modes.update({failure["mode"] for failure in sparring.critique(scenario, actions)["failures"]})
    return {mode: modes[mode] / len(episodes) for mode in sorted(modes)}


def aimed_episodes(curriculum: sparring.Curriculum) -> dict[str, int]:
    """Returns the number of finished episodes on layouts that aim at each failure mode, in the run of a curriculum.

    Raises:
        CurriculumError: The server does not answer.
    """
    episodes: Counter[str] = Counter()
    path = f"/v1/runs/{curriculum.run}/designs?limit={PAGE}"
    page = curriculum.request("GET", path)
    while True:
        for design in page["designs"]:
            if design["aim"] is not None and design["results"]["episodes"] > 0:
                episodes[design["aim"]["mode"]] += design["results"]["episodes"]
        if page["next"] is None:
            return dict(sorted(episodes.items()))
        page = curriculum.request("GET", f"{path}&cursor={page['next']}")
