"""Flies all trainings of an experiment, one after another or some at once; what is done already is left alone."""

from __future__ import annotations

import json
import multiprocessing
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from queue import Empty
from typing import Any

from .. import Curriculum, _native
from ..curriculum import plain_token
from ..server import Server
from . import training
from .findings import compared, read
from .plan import BASELINE, COMPARED, Experiment, Training, Where, Wrong, write

#: The server's database, in the experiment's folder: runs, evaluations, and what they rest on.
DATABASE = "runs.sqlite3"

#: Told what is flown: the training, and how many steps more.
Told = Callable[[Training, int], None]


def missing(folder: Path, experiment: Experiment) -> list[Training]:
    """Trainings that are not done."""
    return [one for one in experiment.trainings() if not training.is_done(folder, one)]


def fly(folder: Path, experiment: Experiment, *, url: str | None, binary: str | None, jobs: int, told: Told) -> None:
    """Flies what is missing, on a server of its own unless `url` says which.

    Raises:
        CurriculumError: There is no server, or it fails.
        Wrong: It does not know the suite.
    """
    waiting = missing(folder, experiment)
    if not waiting and compared(folder, read(folder)) is not None:
        return
    with _server(folder, url, binary) as at:
        _known(at, experiment.suite)
        if jobs == 1:
            for one in waiting:
                training.fly(folder, experiment, one, at, lambda steps, one=one: told(one, steps))  # type: ignore[misc]
        else:
            _at_once(folder, experiment, waiting, at, jobs, told)
        _compare(folder, at)


def _known(at: Where, suite: str | None) -> None:
    told = json.loads(_native.NativeLink(at.url, plain_token(at.token)).ask("GET", "/v1/suites"))["suites"]
    known = [one["name"] for one in told]
    if suite is not None and suite not in known:
        raise Wrong(f"suite: there is no {suite}; the server knows {', '.join(known)}")


def _compare(folder: Path, at: Where) -> None:
    found = read(folder)
    of, rows = found.evaluations(), {}
    if BASELINE in of:
        run = next(iter(found.done.values()))["run"]
        with Curriculum(at.url, run, token=at.token) as curriculum:
            for arm in of.keys() - {BASELINE}:
                rows[arm] = curriculum.ask("GET", f"/v1/evaluations/compare?a={of[arm]}&b={of[BASELINE]}")["rows"]
    write(folder / COMPARED, {"of": of, "rows": rows})


@contextmanager
def _server(folder: Path, url: str | None, binary: str | None) -> Iterator[Where]:
    if url is not None:
        yield Where(url)
        return
    server = Server(folder / DATABASE, binary)
    try:
        yield Where(server.url, "")
    finally:
        server.stop()


def _at_once(folder: Path, experiment: Experiment, waiting: list[Training], at: Where, jobs: int, told: Told) -> None:
    # Threads of a learner do not survive a fork.
    context = multiprocessing.get_context("spawn")
    with context.Manager() as manager, ProcessPoolExecutor(jobs, mp_context=context, initializer=_alone) as pool:
        queue, stop = manager.Queue(), manager.Event()
        running = [pool.submit(_one, folder, experiment, one, at, queue, stop) for one in waiting]
        try:
            while any(not future.done() for future in running) and not _failed(running):
                _hear(queue, told)
                time.sleep(0.2)
            _hear(queue, told)
            for future in running:
                if future.done():
                    future.result()
        finally:
            # A pool hands out one more than its processes work on, which is not cancelled any more.
            stop.set()
            pool.shutdown(cancel_futures=True)


def _alone() -> None:
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")


def _one(folder: Path, experiment: Experiment, one: Training, at: Where, queue: Any, stop: Any) -> None:
    def told(steps: int) -> None:
        if stop.is_set():
            raise RuntimeError("the others were stopped")
        queue.put((one, steps))

    told(0)
    training.fly(folder, experiment, one, at, told)


def _failed(running: list[Future[None]]) -> bool:
    return any(future.done() and future.exception() is not None for future in running)


def _hear(queue: Any, told: Told) -> None:
    while True:
        try:
            one, steps = queue.get_nowait()
        except Empty:
            return
        told(one, steps)
