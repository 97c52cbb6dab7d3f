"""Runs the trainings of an experiment that are not complete, one by one or in parallel."""

from __future__ import annotations

import functools
import json
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from queue import Empty
from typing import Any

from .. import Curriculum, _native
from ..connection import read_token
from ..server import Server
from . import training as trainings
from .experiment import BASELINE, COMPARISON_FILE, Experiment, ExperimentError, ServerAddress, Training, write_json
from .processes import CONTEXT, open_pool
from .results import read, read_comparison

#: The server's database in the experiment's folder, with runs and evaluations.
DATABASE = "runs.sqlite3"

#: Called with a training and its number of new steps.
Progress = Callable[[Training, int], None]


def missing_trainings(folder: Path, experiment: Experiment) -> list[Training]:
    """Returns the trainings that are not complete."""
    return [training for training in experiment.trainings() if not trainings.is_done(folder, training)]


def run(folder: Path, experiment: Experiment, *, url: str | None, binary: str | None, jobs: int, progress: Progress) -> None:
    """Runs the missing trainings and compares the arms.

    Args:
        folder: Folder of the experiment.
        experiment: Its definition.
        url: Address of a server; None to start one.
        binary: Program of the server to start.
        jobs: Number of trainings in parallel.
        progress: Called after each rollout.

    Raises:
        CurriculumError: The server does not start, does not answer or fails.
        ExperimentError: The server does not have the suite.
    """
    missing = missing_trainings(folder, experiment)
    if not missing and read_comparison(folder, read(folder)) is not None:
        return
    with _open_server(folder, url, binary) as address:
        _check_suite(address, experiment.suite)
        if jobs == 1:
            for training in missing:
                trainings.run(folder, experiment, training, address, functools.partial(progress, training))
        else:
            _run_parallel(folder, experiment, missing, address, jobs, progress)
        _compare(folder, address)


def _check_suite(address: ServerAddress, suite: str | None) -> None:
    client = _native.NativeHttpClient(address.url, read_token(address.token))
    known = [row["name"] for row in json.loads(client.request("GET", "/v1/suites"))["suites"]]
    if suite is not None and suite not in known:
        raise ExperimentError(f"--suite must be one of the server's suites, {', '.join(known)}, got {suite}")


def _compare(folder: Path, address: ServerAddress) -> None:
    results = read(folder)
    evaluations, rows = results.evaluations(), {}
    if BASELINE in evaluations:
        run = next(iter(results.done.values()))["run"]
        with Curriculum(address.url, run, token=address.token) as curriculum:
            for arm in evaluations.keys() - {BASELINE}:
                path = f"/v1/evaluations/compare?a={evaluations[arm]}&b={evaluations[BASELINE]}"
                rows[arm] = curriculum.request("GET", path)["rows"]
    write_json(folder / COMPARISON_FILE, {"of": evaluations, "rows": rows})


@contextmanager
def _open_server(folder: Path, url: str | None, binary: str | None) -> Iterator[ServerAddress]:
    if url is not None:
        yield ServerAddress(url)
        return
    server = Server(folder / DATABASE, binary)
    try:
        yield ServerAddress(server.url, "")
    finally:
        server.stop()


def _run_parallel(
    folder: Path, experiment: Experiment, missing: list[Training], address: ServerAddress, jobs: int, progress: Progress
) -> None:
    with CONTEXT.Manager() as manager, open_pool(jobs) as pool:
        queue, stop = manager.Queue(), manager.Event()
        futures = [pool.submit(_run_one, folder, experiment, training, address, queue, stop) for training in missing]
        try:
            while any(not future.done() for future in futures) and not _has_failed(futures):
                _report_progress(queue, progress)
                time.sleep(0.2)
            _report_progress(queue, progress)
            for future in futures:
                if future.done():
                    future.result()
        finally:
            # The pool has already queued one training that cannot be cancelled; it reads this event.
            stop.set()
            pool.shutdown(cancel_futures=True)


def _run_one(folder: Path, experiment: Experiment, training: Training, address: ServerAddress, queue: Any, stop: Any) -> None:
    def progress(steps: int) -> None:
        if stop.is_set():
            raise RuntimeError("the training was stopped because another one failed")
        queue.put((training, steps))

    progress(0)
    trainings.run(folder, experiment, training, address, progress)


def _has_failed(futures: list[Future[None]]) -> bool:
    return any(future.done() and future.exception() is not None for future in futures)


def _report_progress(queue: Any, progress: Progress) -> None:
    while True:
        try:
            training, steps = queue.get_nowait()
        except Empty:
            return
        progress(training, steps)
