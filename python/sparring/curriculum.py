"""The curriculum of a run, as an argument of environments."""

from __future__ import annotations

import atexit
import functools
import json
import os
import sys
import weakref
from collections.abc import Mapping
from typing import Any, Literal
from urllib.parse import quote

import numpy as np

from . import _native
from ._native import CurriculumError as CurriculumError
from .scenario import plain_dict, to_json
from .server import Server

Form = Literal["auto", "groups", "columns"]

#: Seconds in which a program that ends without closing hands in what it flew.
AT_EXIT_S = 15.0
#: Environments from which on `form="auto"` takes columns.
MANY = 256
#: Episodes of a lease of groups, and of one of columns, at most.
EPISODES, COLUMNS = 16_384, 100_000


class Curriculum:
    """What a run proposes, fetched ahead and reported by threads of its own.

    Give it to `sparring.make_vec(curriculum=…)`: environments fly what the run's strategy proposes, and every episode goes back
    with its actions, from which the server works out its score. Stepping waits for the network only where there is nothing
    left to fly. A server that is away costs nothing as long as there is; what is flown meanwhile is kept, up to `buffer`
    episodes, and handed in when it is back.

    Args:
        url: Where the server is.
        run: The run's id. Without one a run is created, with `settings`.
        token: A trainer's, where the server wants one; `SPARRING_TOKEN` unless told, and none if it is empty.
        settings: Of a run that is created: `tasks`, `strategy`, `group_size` … as `POST /v1/runs` takes them.
        form: How episodes are reported. `groups`: every action log is replayed, contested scenarios and designed layouts are
            among them: for a few thousand episodes a second. `columns`: scores are claimed and some logs audited: for more.
            `auto`: columns from 256 environments on, where the run's strategy goes with them.
        lease: Groups of a lease (64; of columns as many as there are environments, 64 to 1 024). Of a lease of columns only the
            groups that are audited move the mastery, and nothing does where more than a tenth was not flown: not too many.
        group_size: Episodes of one scenario (the run's).
        purpose: `train`, `probe` (evidence without exploring) or `eval` (evaluation seeds, which move nothing).
        evaluation: With `purpose="eval"`: the evaluation whose scenarios are flown; environments rest when none is left.
        ahead: Episodes that are kept ready (twice the environments, at least).
        buffer: Episodes that are kept while the server is away.
        patience_s: How long a step waits for something to fly, or for room, before it raises `CurriculumError`.
        ttl_s: Seconds until what was leased and not heard of is somebody else's: longer than an episode takes.

    A process that is forked has no curriculum: it makes one of its own, with the same `run`.

    Raises:
        CurriculumError: No server, no such run, or it refuses.
        ValueError: What is unknown or out of range, with the field.
    """

    def __init__(
        self,
        url: str = "http://127.0.0.1:8700",
        run: str | None = None,
        *,
        token: str | None = None,
        settings: Mapping[str, Any] | None = None,
        form: Form = "auto",
        lease: int | None = None,
        group_size: int | None = None,
        purpose: Literal["train", "probe", "eval"] = "train",
        evaluation: str | None = None,
        ahead: int = 1,
        buffer: int = 100_000,
        patience_s: float = 60.0,
        ttl_s: int = 600,
    ) -> None:
        if form not in ("auto", "groups", "columns"):
            raise ValueError(f"form: {form!r} is none of auto, groups, columns")
        if purpose not in ("train", "probe", "eval"):
            raise ValueError(f"purpose: {purpose!r} is none of train, probe, eval")
        if purpose == "eval" and form == "columns":
            raise ValueError("form: an evaluation is flown as groups")
        for name, value, most in (("lease", lease, 1024), ("group_size", group_size, 1024), ("ahead", ahead, 2**20),
                                  ("buffer", buffer, 2**31), ("ttl_s", ttl_s, 24 * 3600)):  # fmt: skip
            if value is not None:
                _whole(name, value, most)
        if not isinstance(patience_s, (int, float, np.number)) or not 0.0 <= patience_s < 1e9:
            raise ValueError(f"patience_s: {patience_s!r} is no number of seconds")
        if not isinstance(url, str) or not url.startswith(("http://", "https://")):
            raise ValueError(f"url: {url!r} is no address like http://127.0.0.1:8700")
        if run is not None and (not isinstance(run, str) or not run):
            raise ValueError(f"run: {run!r} is no name of a run")
        wanted = json.loads(to_json("settings", plain_dict("settings", settings)))
        self.url = url
        self.token = plain_token(token)
        self._pid = os.getpid()
        self._link = _native.NativeLink(url, self.token)
        if run is None:
            run = str(self.ask("POST", "/v1/runs", wanted)["id"])
        elif settings is not None:
            raise ValueError("settings: they are of a run that is created; this one exists")
        self.run = run
        self._name = quote(run, safe="")
        told = self.ask("GET", f"/v1/runs/{self._name}")
        self._group_size = int(told["settings"]["group_size"])
        #: The tasks of the run.
        self.tasks: tuple[str, ...] = tuple(row["task"] for row in told["settings"]["curriculum"]["tasks"])
        self._wish: dict[str, Any] = {
            "group_size": group_size,
            "purpose": purpose,
            "evaluation": evaluation,
            "ttl_s": ttl_s,
            "ahead": ahead,
            "buffer": buffer,
            "patience_s": float(patience_s),
        }
        self._form, self._lease = ("groups" if purpose == "eval" else form), lease
        self._native: _native.NativeCurriculum | None = None
        self._version = int(told["policy_version"])  # a training that goes on counts on
        self._closed = False
        self._server: Server | None = None
        # A program that ends without closing has what it flew handed in. By a weak reference: who is forgotten is not kept.
        self._leave = functools.partial(_call, weakref.WeakMethod(self._at_exit))
        atexit.register(self._leave)

    def _at_exit(self) -> None:
        # What a forked process inherits is its parent's to hand in.
        if self._native is not None and not self._closed and os.getpid() == self._pid:
            try:
                self.close(AT_EXIT_S)
            except CurriculumError as error:
                print(f"sparring: a curriculum was not closed, and at the end: {error}", file=sys.stderr)

    def __del__(self) -> None:
        # Whoever forgets a curriculum, as a notebook's cell that is run again does, has handed in what was flown, too.
        if hasattr(self, "_leave"):
            self._at_exit()
            atexit.unregister(self._leave)

    @classmethod
    def local(
        cls,
        db: str | os.PathLike[str] | None = None,
        run: str | None = None,
        *,
        binary: str | None = None,
        **settings: Any,
    ) -> Curriculum:
        """Starts a server on this machine for as long as the curriculum is used, on a port nobody else has.

        Args:
            db: Its database, which stays; one that is forgotten afterwards unless told.
            run: A run that is in it; one is created otherwise.
            binary: The program. Unless told it is `SPARRING_BIN`, or `sparring` beside this Python, where
                `pip install sparring-server` puts it, or on the path.
            settings: As `Curriculum` takes them.

        Raises:
            CurriculumError: No such program, or it does not start.
        """
        server = Server(db, binary)
        try:
            if settings.get("token") is None and _open(server.url):
                settings["token"] = ""  # what `SPARRING_TOKEN` has is another's
            made = cls(server.url, run, **settings)
        except BaseException:
            server.stop()
            raise
        made._server = server
        made._watch(server)
        return made

    @classmethod
    def find(
        cls, url: str | None = None, run: str | None = None, *, settings: Mapping[str, Any] | None = None, **wish: Any
    ) -> Curriculum:
        """The curriculum of a server that is there or, without an address, of one that is started for as long as it is used.

        Args:
            url: Where the server is, if there is one.
            run: A run of that server; one is created otherwise, with `settings`.
            settings, wish: As `Curriculum` takes them.

        Raises:
            ValueError: A run without the address of its server, or what `Curriculum` refuses.
            CurriculumError: No server, no program to start, or it refuses.
        """
        if url is None and run is not None:
            raise ValueError("run: it is one of a server's, which url has to say")
        settings = settings if run is None else None
        return cls.local(settings=settings, **wish) if url is None else cls(url, run, settings=settings, **wish)

    def _watch(self, server: Server) -> None:
        server.watch(functools.partial(_call, weakref.WeakMethod(self._gone)))

    def _gone(self, why: str) -> None:
        # Others may come back; one that was this process's own does not, and whoever waited for it would wait for nothing.
        if self._native is not None and not self._closed:
            self._native.gone(why)

    def __repr__(self) -> str:
        return f"Curriculum({self.url!r}, run={self._name!r})"

    def _here(self) -> None:
        if os.getpid() != self._pid:
            raise CurriculumError("the curriculum is another process's: one that was forked makes its own, with the same run")

    def attach(self, num_envs: int) -> _native.NativeCurriculum:
        """What environments fly by; the first to ask decides which form `auto` is."""
        self._here()
        if self._closed:
            raise CurriculumError("the curriculum is closed")
        if self._native is None:
            columns = self._form == "columns" or (self._form == "auto" and num_envs >= MANY and self._goes_with_columns())
            size = self._wish["group_size"] or self._group_size
            usual = max(1, min(64, EPISODES // size))
            ahead = max(1, min(max(num_envs, 64), 1024, COLUMNS // size))
            groups = self._lease or (ahead if columns else usual)
            otherwise = self._lease or usual if self._form == "auto" else None
            self._native = _native.NativeCurriculum(
                self.url, self.run, self.token, columns=columns, groups=groups, otherwise=otherwise, **self._wish
            )
            self._native.policy_version = self._version
        return self._native

    def _goes_with_columns(self) -> bool:
        mine = self.ask("GET", f"/v1/runs/{self._name}")["settings"]["curriculum"]["strategy"]
        known = self.ask("GET", "/v1/strategies")["strategies"]
        return any(one["columns"] for one in known if one["name"] == mine)

    @property
    def policy_version(self) -> int:
        """Which policy flies from now on: the newest the run knows at first; set it whenever the policy has changed."""
        return self._version

    @policy_version.setter
    def policy_version(self, version: int) -> None:
        if isinstance(version, bool) or not isinstance(version, (int, np.integer)) or not 0 <= version < 2**32:
            raise ValueError(f"policy_version: {version!r} is not a whole number from 0 to 4294967295")
        self._here()
        if self._native is not None:
            self._native.policy_version = int(version)
        self._version = int(version)

    def stats(self) -> dict[str, Any]:
        """What became of what was flown, in episodes: `flown`, `counted`, `accepted`, `waiting`, `late`, … and since when the
        server is away (`away_s`); docs/python.md has all of it."""
        self._here()
        return {} if self._native is None else dict(json.loads(self._native.stats()))

    def mastery(self) -> list[dict[str, Any]]:
        """Per task: level, mastery with its interval, plain success, skill, params in force."""
        return list(self.ask("GET", f"/v1/runs/{self._name}/mastery")["tasks"])

    def numbers(self) -> dict[str, float]:
        """What is worth a curve, by its name: of each task `level` and `mastery` with `mastery_q10` and `mastery_q90` (from when
        placement has found its level), `success`, `score` and `skill` as the scenarios came, `zero_variance_share`, each of
        `params/…`; and of this trainer `episodes/flown`, `episodes/waiting` …"""
        told: dict[str, float] = {}
        for row in self.mastery():
            task = row["task"]
            # Strategies without levels have none, nor has anybody during placement: what is probed is no level yet.
            mastery, plain = (row["mastery"] or {}) if row["placed"] else {}, row["plain"]
            named = {
                "level": row["level"],
                "mastery": mastery.get("mean"),
                "mastery_q10": mastery.get("q10"),
                "mastery_q90": mastery.get("q90"),
                **{name: plain[name] for name in ("success", "score", "skill")},
                "zero_variance_share": row["groups"]["zero_variance_share"],
                **{f"params/{name}": value for name, value in row["params"].items()},
            }
            told.update({f"{task}/{name}": float(value) for name, value in named.items() if value is not None})
        stats = self.stats()
        told.update({f"episodes/{name}": float(value) for name, value in stats.items() if isinstance(value, (int, float))})
        return told

    def ask(self, method: str, path: str, body: Any = None) -> Any:
        """Asks the server something else; `sparring.Client` has all there is, with types.

        Raises:
            CurriculumError: It refuses, or nobody answers.
        """
        self._here()
        return json.loads(self._link.ask(method, path, None if body is None else to_json("body", body)))

    def reach(self) -> None:
        """Waits until the server answers, for as long as this has patience: one that is being restarted ends no training.

        Raises:
            CurriculumError: It does not, or refuses.
        """
        self._here()
        # One of its own that ended does not come back.
        self._link.ask("GET", f"/v1/runs/{self._name}", patience_s=self._wish["patience_s"], wait=self._server is None)

    def beside(self, **wish: Any) -> Curriculum:
        """Another part of the same run, as patient, for other environments: `purpose="eval"`, for one. It has to be closed by
        itself."""
        wish.setdefault("patience_s", self._wish["patience_s"])
        made = Curriculum(self.url, self.run, token=self.token or "", **wish)
        made.policy_version = self.policy_version
        if self._server is not None:
            made._watch(self._server)
        return made

    def flush(self, timeout_s: float = 60.0) -> None:
        """Waits until the server has what was flown of whole leases.

        Raises:
            CurriculumError: It has not after this time, or refuses some of it.
        """
        self._here()
        if self._native is not None:
            self._native.flush(timeout_s)

    def close(self, timeout_s: float = 60.0) -> None:
        """Hands in what was flown, gives back what was not, and stops a server of its own. In a process that was forked it does
        nothing: all of that is the parent's.

        Args:
            timeout_s: How long what waits may take; `math.inf`: as long as it takes.

        Raises:
            CurriculumError: What was flown could not be handed in, or was refused.
            ValueError: No number of seconds. Nothing is closed then, nor where it is interrupted: what waits is handed in by
                closing once more, or when the program ends.
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
        atexit.unregister(self._leave)
        if self._server is not None:
            self._server.stop()

    def __enter__(self) -> Curriculum:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def plain_token(token: str | None) -> str | None:
    """A token that can be sent: the one that is given, an empty one being none, or `SPARRING_TOKEN`.

    Raises:
        ValueError: One that is none; it is not repeated.
    """
    if token is not None and not isinstance(token, str):
        raise ValueError("token: no text")
    token = (os.environ.get("SPARRING_TOKEN", "") if token is None else token).strip()
    if not all("!" <= letter <= "~" for letter in token):
        raise ValueError("token: it has other characters than a token has")
    return token or None


def _whole(name: str, value: Any, most: int) -> None:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 1 <= value <= most:
        raise ValueError(f"{name}: {value!r} is not a whole number from 1 to {most}")


def _open(url: str) -> bool:
    """Whether a server answers those without a token: none were made for its database."""
    try:
        _native.NativeLink(url).ask("GET", "/v1/runs?limit=1")
    except CurriculumError:
        return False
    return True


def _call(method: weakref.WeakMethod[Any], *words: str) -> None:
    there = method()
    if there is not None:
        there(*words)
