"""Runs the recorder of BSK-RL's episodes, in scripts/bsk_record, on sparring.tasking.

Its modules import `bsk_rl`. Here these imports find sparring.tasking, under all names of its modules.
"""

from __future__ import annotations

import contextlib
import dataclasses
import gzip
import importlib
import json
import pkgutil
import sys
import types
from pathlib import Path

import sparring.tasking

ROOT = Path(__file__).parents[3]
FOLDER = ROOT / "env-core" / "fixtures" / "tasking"
PACKAGE = "sparring.tasking"


@contextlib.contextmanager
def recorder():
    """Yields the modules of the recorder that build, run and describe episodes."""
    for module in pkgutil.walk_packages(sparring.tasking.__path__, PACKAGE + "."):
        importlib.import_module(module.name)
    before = set(sys.modules)
    own = {name: module for name, module in sys.modules.items() if name == PACKAGE or name.startswith(PACKAGE + ".")}
    sys.modules.update({"bsk_rl" + name.removeprefix(PACKAGE): module for name, module in own.items()})
    macros = types.SimpleNamespace(NANO2SEC=1e-9)
    for name in ("Basilisk", "Basilisk.utilities"):
        sys.modules[name] = types.ModuleType(name)
    sys.modules["Basilisk.utilities"].macros = macros
    sys.path.insert(0, str(ROOT / "scripts"))
    try:
        yield types.SimpleNamespace(
            episodes=importlib.import_module("bsk_record.episodes").EPISODES,
            run=importlib.import_module("bsk_record.recorder"),
            components=importlib.import_module("bsk_record.components"),
            plain=importlib.import_module("bsk_record.encode").plain,
        )
    finally:
        sys.path.remove(str(ROOT / "scripts"))
        for name in set(sys.modules) - before:
            if name.split(".")[0] in ("bsk_rl", "Basilisk", "bsk_record"):
                del sys.modules[name]


def read(folder, name):
    """Returns a recording of a folder."""
    return json.loads(gzip.decompress((FOLDER / folder / f"{name}.json.gz").read_bytes()))


def names(folder):
    """Returns the names of the recordings in a folder."""
    return sorted(path.name.removesuffix(".json.gz") for path in (FOLDER / folder).glob("*.json.gz"))


def without_trace(episode):
    """Returns an episode whose recording has no values of every tick."""
    return dataclasses.replace(episode, traced=False)
