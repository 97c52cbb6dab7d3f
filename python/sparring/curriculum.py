"""The curriculum of a run, as an argument of environments."""

from __future__ import annotations

import atexit
import functools
import json
import os
import sys
import weakref
from collections.abc import Mapping
from typing import Any, SupportsFloat
from urllib.parse import quote

import numpy as np

from . import _native
from ._native import CurriculumError as CurriculumError
from .connection import DEFAULT_URL as DEFAULT_URL
from .connection import needs_token, read_token
from .curriculum_arguments import Form, Purpose, check_modes, check_numbers, check_settings, default_column_groups, default_groups
from .errors import invalid
from .metrics import task_metrics
from .scenario import copy_mapping, to_json
from .server import Server
from .trainer_metrics import MetricsSender, metrics_request

#: Timeout of submitting results when a program exits without `close`, seconds.
EXIT_TIMEOUT_S = 15.0
#: Timeout of sending the last metrics of the trainer when the curriculum is closed, seconds.
METRICS_TIMEOUT_S = 5.0
#: Number of environments from which on `form="auto"` uses columns.
MIN_COLUMN_ENVS = 256


class Curriculum:
    """Source of the scenarios that a run's strategy proposes; receives the outcomes.

    Pass it to `sparring.make_vec(curriculum=…)`. Background threads lease episodes ahead and submit their actions, from which
    the server computes the scores. A step waits for the network only if no episode is ready. While the server is
    unreachable, the environments run the ready episodes, and the curriculum stores up to `buffer` results.

    Args:
        url: Address of the server.
        run: Id of the run; without it a run is created with `settings`.
        token: Token of a trainer (default `SPARRING_TOKEN`; empty text: none).
        settings: Settings of the run to create, as for `POST /v1/runs`: `tasks`, `strategy`, `group_size` …
        form: Form of the reports. `groups`: the server replays every action log, and serves contested scenarios and designed
            layouts; up to a few thousand episodes/s. `columns`: the curriculum claims scores, and the server audits some of
            them; tens of thousands of episodes/s. `auto`: columns from 256 environments on, if the run's strategy supports
            them.
        lease_groups: Groups of a lease (64; for columns the number of environments, from 64 to 1 024). The scenarios of groups
            are disclosed as episodes are needed, and groups that were never begun return to the run without loss. Of a lease of
            columns only the audited groups move the mastery.
        group_size: Episodes per scenario (default: the run's).
        purpose: `train`, `probe` (evidence without exploration) or `eval` (evaluation seeds, no effect on the curriculum).
        evaluation: With `purpose="eval"`, id of the evaluation; environments become idle when no scenario is left.
        ahead: Number of episodes to keep ready, in addition to two per environment.
        buffer: Maximum number of episodes that wait to be submitted.
        max_wait_s: Seconds that a step waits for an episode or for space in the buffer before it raises `CurriculumError`.
        ttl_s: Lifetime of a lease without renewal, 1 to 86 400 seconds; longer than an episode. The server offers the episodes
            of an expired lease to other clients.

    A forked process cannot use the curriculum. It must make one with the same `run`. A pickled curriculum opens the run in the
    process that loads it, with the token in `SPARRING_TOKEN` of that process: tokens are not pickled.

    Raises:
        CurriculumError: The server does not answer, has no such run, or rejects the request.
        ValueError: A value is unknown or out of range; the message names the field.
    """

    def __init__(
        self,
        url: str = DEFAULT_URL,
        run: str | None = None,
        *,
        token: str | None = None,
        settings: Mapping[str, Any] | None = None,
        form: Form = "auto",
        lease_groups: int | None = None,
        group_size: int | None = None,
        purpose: Purpose = "train",
        evaluation: str | None = None,
        ahead: int = 1,
        buffer: int = 100_000,
        max_wait_s: float = 60.0,
        ttl_s: int = 600,
    ) -> None:
        check_modes(form, purpose)
        check_numbers(max_wait_s, lease_groups=lease_groups, group_size=group_size, ahead=ahead, buffer=buffer, ttl_s=ttl_s)
        if not isinstance(url, str) or not url.startswith(("http://", "https://")):
            raise invalid("url", f"an address such as {DEFAULT_URL}", url)
        if run is not None and (not isinstance(run, str) or not run):
            raise invalid("run", "the id of a run, or None to create one", run)
        body = json.loads(to_json("settings", copy_mapping("settings", settings)))
        self.url = url
        self.token = read_token(token)
        self._pid = os.getpid()
        self._http = _native.NativeHttpClient(url, self.token)
        if run is None:
            run = str(self.request("POST", "/v1/runs", body)["id"])
        else:
            check_settings(self._http, run, settings)
        self.run = run
        self._run_path = f"/v1/runs/{quote(run, safe='')}"
        self._metrics = MetricsSender(functools.partial(self._http.request, "POST", f"{self._run_path}/metrics", max_wait_s=0.0))
        summary = self.request("GET", self._run_path)
        self._run_group_size = int(summary["settings"]["group_size"])
        #: Tasks of the run.
        self.tasks: tuple[str, ...] = tuple(row["task"] for row in summary["settings"]["curriculum"]["tasks"])
        self._lease_settings: dict[str, Any] = {
            "group_size": group_size,
            "purpose": purpose,
            "evaluation": evaluation,
            "ttl_s": ttl_s,
            "ahead": ahead,
            "buffer": buffer,
            "max_wait_s": float(max_wait_s),
        }
        self._form, self._lease_groups = ("groups" if purpose == "eval" else form), lease_groups
        self._native: _native.NativeCurriculum | None = None
        self._version = int(summary["policy_version"])  # a resumed training continues from the newest version
        self._closed = False
        self._server: Server | None = None
        # Submits results when the program ends without close; the weak reference lets an unused curriculum be deleted.
        self._exit_hook = functools.partial(_call, weakref.WeakMethod(self._at_exit))
        atexit.register(self._exit_hook)

    @classmethod
    def local(
        cls,
        db: str | os.PathLike[str] | None = None,
        run: str | None = None,
        *,
        binary: str | None = None,
        **settings: Any,
    ) -> Curriculum:
        """Starts a server on a free port of this machine, which stops when the curriculum is closed.

        Args:
            db: Database file; None for a temporary one, which is deleted with the server.
            run: Id of a run in the database; without it a run is created.
            binary: Program to start (default: `SPARRING_BIN`, else the `sparring` that `pip install sparring-server` puts
                beside this Python, else the one on the path).
            settings: Other arguments of `Curriculum`.

        Raises:
            CurriculumError: There is no such program, or it does not start.
        """
        server = Server(db, binary)
        try:
            if settings.get("token") is None and not needs_token(server.url):
                settings["token"] = ""  # the token in `SPARRING_TOKEN` belongs to another server
            curriculum = cls(server.url, run, **settings)
        except BaseException:
            server.stop()
            raise
        curriculum._server = server
        curriculum._watch(server)
        return curriculum

    @classmethod
    def open(
        cls, url: str | None = None, run: str | None = None, *, settings: Mapping[str, Any] | None = None, **arguments: Any
    ) -> Curriculum:
        """Opens the curriculum of a running server or, without an address, of a new local server.

        Args:
            url: Address of the server, if there is one.
            run: Id of a run of that server; without it a run is created with `settings`.
            settings: Settings of the run to create; ignored with `run`.
            arguments: Other arguments of `Curriculum`.

        Raises:
            ValueError: `run` is given without `url`, or `Curriculum` rejects an argument.
            CurriculumError: The server does not answer, the program is missing, or the server rejects the request.
        """
        if url is None and run is not None:
            raise ValueError(f"`run` must be omitted without `url`, got {run!r}; pass the url of the server that has the run")
        settings = settings if run is None else None
        if url is None:
            return cls.local(settings=settings, **arguments)
        return cls(url, run, settings=settings, **arguments)

    def reopen(self, **arguments: Any) -> Curriculum:
        """Opens the same run once more, for other environments and with other arguments, such as `purpose="eval"`.

        The result has this curriculum's `max_wait_s` and `policy_version`. The caller closes it.
        """
        arguments.setdefault("max_wait_s", self._lease_settings["max_wait_s"])
        curriculum = Curriculum(self.url, self.run, token=self.token or "", **arguments)
        curriculum.policy_version = self.policy_version
        if self._server is not None:
            curriculum._watch(self._server)
        return curriculum

    def attach(self, num_envs: int) -> _native.NativeCurriculum:
        """Returns the compiled curriculum for a batch of environments; the first call resolves `form="auto"`."""
        self._check_process()
        if self._closed:
            raise CurriculumError("the curriculum is closed: open another one with the same run")
        if self._native is None:
            columns = self._form == "columns" or (
                self._form == "auto" and num_envs >= MIN_COLUMN_ENVS and self._supports_columns()
            )
            of_groups = self._lease_groups or default_groups(self.group_size)
            groups = self._lease_groups or default_column_groups(self.group_size, num_envs) if columns else of_groups
            fallback_groups = of_groups if self._form == "auto" else None
            self._native = _native.NativeCurriculum(
                self.url,
                self.run,
                self.token,
                columns=columns,
                groups=groups,
                fallback_groups=fallback_groups,
                **self._lease_settings,
            )
            self._native.policy_version = self._version
        return self._native

    def _supports_columns(self) -> bool:
        strategy = self.request("GET", self._run_path)["settings"]["curriculum"]["strategy"]
        strategies = self.request("GET", "/v1/strategies")["strategies"]
        return any(row["supports_columns"] for row in strategies if row["name"] == strategy)

    @property
    def group_size(self) -> int:
        """Number of episodes of each scenario: that of this curriculum's leases, else the run's."""
        return int(self._lease_settings["group_size"] or self._run_group_size)

    @property
    def policy_version(self) -> int:
        """Policy version of the episodes that begin from now on; at first the newest of the run.

        Set it whenever the policy has changed.
        """
        return self._version

    @policy_version.setter
    def policy_version(self, version: int) -> None:
        if isinstance(version, bool) or not isinstance(version, (int, np.integer)) or not 0 <= version < 2**32:
            raise invalid("policy_version", "an integer from 0 to 4294967295", version)
        self._check_process()
        if self._native is not None:
            self._native.policy_version = int(version)
        self._version = int(version)

    def stats(self) -> dict[str, Any]:
        """Returns counts of this trainer's episodes by outcome: `finished`, `counted`, `accepted`, `unsent`, `late` …

        `unreachable_s` is the time since the server became unreachable, in seconds. docs/reference/python.md lists all keys.
        """
        self._check_process()
        return {} if self._native is None else dict(json.loads(self._native.stats()))

    def mastery(self) -> list[dict[str, Any]]:
        """Returns for each task its level, mastery with interval, success rate, skill and current params."""
        return list(self.request("GET", f"{self._run_path}/mastery")["tasks"])

    def metrics(self) -> dict[str, float]:
        """Returns metrics for training curves by name.

        Each task has `rung`, the mean rung of its latest proposals, and `success`, `score`, `skill` and
        `zero_variance_share` of all its episodes. Under a strategy with levels it has `level`, `mastery` with `mastery_q10`
        and `mastery_q90`, and `params/…`, once placement has found its level. `episodes/…` are the numbers of `stats()`.
        """
        metrics: dict[str, float] = {}
        for row in self.mastery():
            metrics.update(task_metrics(row))
        stats = self.stats()
        metrics.update({f"episodes/{name}": float(value) for name, value in stats.items() if isinstance(value, (int, float))})
        return metrics

    def log_metrics(self, step: int, metrics: Mapping[str, SupportsFloat | None]) -> None:
        """Logs metrics of the trainer, such as a loss, which the dashboard shows beside the curriculum's.

        A thread sends them, so that a training never waits for the server. Metrics that the server refuses, such as more than
        ten calls a second, and those during an outage are dropped with one warning.

        Args:
            step: Step of the trainer, such as its number of environment steps, from 0 to 2^53 - 1. Metrics of the same step are
                replaced.
            metrics: Numbers by name, at most 100 in a run. Numbers that are not finite are stored as gaps. Characters of names
                other than a-z, A-Z, 0-9, `_`, `.`, `:`, `/` and `-` become `_`; names are cut to 128 characters.

        Raises:
            ValueError: The step or a metric is invalid, or there are more than 100 metrics.
            CurriculumError: The curriculum belongs to another process.
        """
        self._check_process()
        request = metrics_request(step, metrics)
        if metrics:
            self._metrics.add(request)

    def request(self, method: str, path: str, body: Any = None) -> Any:
        """Sends any request to the server and returns its JSON; `sparring.Client` has all operations with types.

        Raises:
            CurriculumError: The server rejects the request or does not answer.
        """
        self._check_process()
        return json.loads(self._http.request(method, path, None if body is None else to_json("body", body)))

    def wait_for_server(self) -> None:
        """Waits until the server answers, for at most `max_wait_s`, so that a training survives a restart of the server.

        Raises:
            CurriculumError: The server does not answer in time, or rejects the request.
        """
        self._check_process()
        # A server of this process is not restarted.
        wait = self._server is None
        self._http.request("GET", self._run_path, max_wait_s=self._lease_settings["max_wait_s"], wait_for_server=wait)

    def flush(self, timeout_s: float = 60.0) -> None:
        """Waits until the results of all complete leases are submitted, and the trainer's metrics are sent.

        Raises:
            CurriculumError: The results are not submitted in time, or the server refused some.
        """
        self._check_process()
        if self._native is not None:
            self._native.flush(timeout_s)
        self._metrics.flush(timeout_s)

    def close(self, timeout_s: float = 60.0) -> None:
        """Submits results, releases unfinished episodes, and stops a local server; does nothing in a forked process.

        Args:
            timeout_s: Maximum time to submit results, in seconds; `math.inf` for no limit.

        Raises:
            CurriculumError: Results could not be submitted, or were refused.
            ValueError: The timeout is invalid. The curriculum stays open then, and after an interrupt. Another call, or the
                end of the program, submits the results.
        """
        if self._closed or os.getpid() != self._pid:
            return
        try:
            if self._native is not None:
                self._native.close(timeout_s)
        except CurriculumError:
            self._end()
            raise
        self._end()

    def _end(self) -> None:
        self._closed = True
        self._metrics.flush(METRICS_TIMEOUT_S)
        atexit.unregister(self._exit_hook)
        if self._server is not None:
            self._server.stop()

    def _watch(self, server: Server) -> None:
        server.on_exit(functools.partial(_call, weakref.WeakMethod(self._server_exited)))

    def _server_exited(self, reason: str) -> None:
        # This process does not restart its server, so waiting for it is pointless.
        if self._native is not None and not self._closed:
            self._native.server_exited(reason)

    def _check_process(self) -> None:
        if os.getpid() != self._pid:
            raise CurriculumError("the curriculum belongs to another process: make one in this process, with the same run")

    def _at_exit(self) -> None:
        # A forked process has no results of its own: its parent submits them.
        if (self._native is not None or self._metrics.is_busy) and not self._closed and os.getpid() == self._pid:
            try:
                self.close(EXIT_TIMEOUT_S)
            except CurriculumError as error:
                print(f"sparring: cannot submit the results of a curriculum that was not closed: {error}", file=sys.stderr)

    def __del__(self) -> None:
        # A deleted curriculum submits its results, too: a notebook deletes it when its cell runs again.
        if hasattr(self, "_exit_hook"):
            self._at_exit()
            atexit.unregister(self._exit_hook)

    def __reduce__(self) -> tuple[Any, ...]:
        arguments = {"form": self._form, "lease_groups": self._lease_groups, **self._lease_settings}
        arguments |= {} if self.token else {"token": ""}
        return functools.partial(type(self), self.url, self.run, **arguments), ()

    def __enter__(self) -> Curriculum:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Curriculum({self.url!r}, run={self.run!r})"


def _call(method: weakref.WeakMethod[Any], *arguments: str) -> None:
    function = method()
    if function is not None:
        function(*arguments)
