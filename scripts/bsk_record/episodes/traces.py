"""Episodes with values of every tick."""

from __future__ import annotations

from bsk_record.episodes.common import NADIR, SCANNING_TIME, scanner
from bsk_record.policies import ScriptPolicy
from bsk_record.specs import Episode, component

ACTIONS = (
    component("NadirPoint", duration=150.0),
    component("Drift", duration=60.0),
    component("Desat", duration=100.0),
    component("Scan", duration=120.0),
)
NADIR_POINT, DRIFT, DESAT, SCAN = range(len(ACTIONS))


def trace(name: str, seed: int, script: tuple[int, ...], args: dict) -> Episode:
    """Returns a traced episode of scripted actions."""
    return Episode(
        name=name,
        seed=seed,
        cls="SatelliteTasking",
        satellites=(scanner(actions=ACTIONS, args=args),),
        scenario=NADIR,
        rewarders=SCANNING_TIME,
        policy=ScriptPolicy(script),
        max_steps=len(script),
        env={"time_limit": 1500.0},
        traced=True,
    )


EPISODES = (
    trace("trace_hill", 1, (NADIR_POINT, SCAN, NADIR_POINT, DRIFT, NADIR_POINT, DESAT, SCAN), {"desatAttitude": "nadir"}),
    trace("trace_desat", 2, (DESAT, DESAT, DRIFT, DESAT, SCAN, DESAT, NADIR_POINT, DESAT), {"desatAttitude": "sun"}),
)
