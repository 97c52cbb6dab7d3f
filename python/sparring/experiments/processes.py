"""Processes of parallel trainings, with one core each."""

from __future__ import annotations

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor

#: Start method of the processes: a learner's threads do not survive a fork.
CONTEXT = multiprocessing.get_context("spawn")


def open_pool(jobs: int) -> ProcessPoolExecutor:
    """Returns a pool of some processes, whose numerical libraries use one thread."""
    return ProcessPoolExecutor(jobs, mp_context=CONTEXT, initializer=_use_one_core)


def _use_one_core() -> None:
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
