"""Recorded episodes by subject; `common.py` has the parts that they share."""

from bsk_record.episodes import (
    communication,
    control,
    deaths,
    limits,
    models,
    observations,
    scenes,
    storage,
    timing,
    traces,
    windows,
)

_MODULES = (communication, storage, timing, scenes, deaths, limits, control, observations, traces, windows, models)

EPISODES = {episode.name: episode for module in _MODULES for episode in module.EPISODES}
