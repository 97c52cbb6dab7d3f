"""Ray Tune: each trial of an RLlib algorithm trains on the curriculum of a run of its own.

curriculum = {"url": "http://127.0.0.1:8700", "settings": {"strategy": tune.grid_search(["auto", "ladder"])}}
config = (
    PPOConfig()
    .environment(sparring.rllib.TEAM, env_config={"curriculum": curriculum})
    .training(lr=tune.grid_search([5e-4, 1e-3]))
    .callbacks(sparring.rllib.CurriculumCallback)
)
results = tune.Tuner(sparring.tune.run_per_trial(PPO, tags=["lr"]), param_space=config).fit()
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

try:
    from ray.rllib.algorithms.algorithm import Algorithm
    from ray.tune.result import TRIAL_INFO
except ImportError as error:
    raise ImportError("sparring.tune needs RLlib: pip install 'sparring[rllib]'") from error

from . import _native
from ._native import CurriculumError
from .connection import read_token, read_url
from .errors import invalid

#: Longest wait of a trial for the server, seconds.
SERVER_WAIT_S = 60.0
#: Maximum length of the id of a run and of a tag, characters.
MAX_ID_CHARS = 64
#: Maximum length of the part of a run's id that names the experiment, characters.
MAX_EXPERIMENT_CHARS = 40
#: Maximum length of the name of a run, characters.
MAX_NAME_CHARS = 200


@dataclass(frozen=True)
class TuneTrial:
    """Trial of an experiment of Tune. The id of its run follows from both names, so that a trial that starts again finds it."""

    #: Name of the experiment, as in `RunConfig(name=…)`.
    experiment: str
    #: Id that Tune gives the trial, the same after an interruption.
    id: str
    #: Name of the trial in Tune's tables.
    name: str
    #: Further tags of the run, such as `lr:0.0005`.
    tags: tuple[str, ...] = ()

    @property
    def run(self) -> str:
        """Id of the run of the trial."""
        experiment = _replace_characters(self.experiment, r"[^a-z0-9_-]+")[:MAX_EXPERIMENT_CHARS]
        return f"{experiment}-{_replace_characters(self.id, r'[^a-z0-9_-]+')}"[:MAX_ID_CHARS]

    def run_tags(self) -> list[str]:
        """Returns the tags of the run: experiment, trial, and the further ones."""
        tags = (self.experiment, f"trial:{self.id}", *self.tags)
        return list(dict.fromkeys(_replace_characters(tag, r"[^a-z0-9_.:-]+")[:MAX_ID_CHARS] for tag in tags))


def run_per_trial(algorithm: type[Algorithm], *, tags: Sequence[str] = ()) -> type[Algorithm]:
    """Makes a trainable for `tune.Tuner` that gives each trial a run of its own: `Tuner(run_per_trial(PPO), param_space=config)`.

    The field `curriculum` of the env_config has `settings`, those of the run to create, instead of `run`. The run has the name of
    the trial, and the experiment and the trial as tags. A trial that starts again, after a failure or with `Tuner.restore`,
    continues its run. Results have the id of the run as `curriculum_run`; `CurriculumCallback` adds the metrics of the run.

    Args:
        algorithm: Class of the algorithm, such as PPO.
        tags: Names of settings of the algorithm's config whose values become tags of the run: `lr` gives `lr:0.0005`.
    """
    names = tuple(tags)

    class CurriculumTrial(algorithm):
        """Algorithm that finds or creates the run of its trial before it makes its env runners."""

        def __init__(self, config: Any = None, *args: Any, **kwargs: Any) -> None:
            # RLlib drops the trial from the config.
            if isinstance(config, Mapping) and TRIAL_INFO in config:
                config = _with_run(config, names)
            super().__init__(config, *args, **kwargs)

        def step(self) -> dict[str, Any]:
            return {**super().step(), "curriculum_run": self.config.env_config["curriculum"]["run"]}

    CurriculumTrial.__name__ = CurriculumTrial.__qualname__ = f"Curriculum{algorithm.__name__}"
    return CurriculumTrial


def _with_run(config: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    """Returns the config of a trial with the run of the trial, unless it has a run already."""
    env_config = dict(config.get("env_config") or {})
    curriculum = dict(env_config.get("curriculum") or {})
    if "run" not in curriculum:
        info = config[TRIAL_INFO]
        values = tuple(f"{name}:{_format(config[name])}" for name in names)
        trial = TuneTrial(info.experiment_name or "tune", info.trial_id, info.trial_name, values)
        curriculum["run"] = open_run(trial, curriculum.pop("settings", {}), curriculum.get("url"), curriculum.get("token"))
    return {**config, "env_config": {**env_config, "curriculum": curriculum}}


def open_run(trial: TuneTrial, settings: Mapping[str, Any], url: str | None = None, token: str | None = None) -> str:
    """Creates the run of a trial, or finds the one that it has created before; returns its id.

    Args:
        trial: Trial that trains on the run.
        settings: Settings of the run, as for `POST /v1/runs`, without `id`.
        url: Address of the server (default `SPARRING_URL`). A server that does not answer is tried for a minute.
        token: Token of a trainer (default `SPARRING_TOKEN`).

    Raises:
        ValueError: The settings have an id.
        CurriculumError: The server does not answer, rejects the request, or has the run with other settings.
    """
    if "id" in settings:
        raise invalid("curriculum.settings.id", "omitted: each trial has a run of its own", settings["id"])
    http, run = _native.NativeHttpClient(read_url(url), read_token(token)), trial.run
    try:
        found = json.loads(http.request("GET", f"/v1/runs/{quote(run, safe='')}", max_wait_s=SERVER_WAIT_S, wait_for_server=True))
    except CurriculumError as error:
        if ": 404: " not in str(error):
            raise
        request = {
            "name": trial.name[:MAX_NAME_CHARS],
            **settings,
            "id": run,
            "tags": list(dict.fromkeys([*settings.get("tags", ()), *trial.run_tags()])),
        }
        http.request("POST", "/v1/runs", json.dumps(request))
        return run
    _check_settings(run, settings, found["settings"])
    return run


def _check_settings(run: str, requested: Mapping[str, Any], stored: Mapping[str, Any]) -> None:
    """Raises an error if a run exists with another strategy, other tasks or another size of groups than a trial requests."""
    curriculum = stored["curriculum"]
    tasks = sorted(row["task"] for row in curriculum["tasks"])
    found = {"strategy": curriculum["strategy"], "tasks": tasks, "group_size": stored["group_size"]}
    for name, value in found.items():
        wanted = requested.get(name, value)
        if (sorted(wanted) if name == "tasks" else wanted) != value:
            raise CurriculumError(
                f"run {run} exists with {name} {value!r}, but its trial has {wanted!r}: give the experiment another name"
            )


def _format(value: Any) -> str:
    return format(value, "g") if isinstance(value, float) else str(value)


def _replace_characters(text: str, invalid_characters: str) -> str:
    """Returns text in lower case with `-` in place of characters that ids or tags cannot have."""
    return re.sub(invalid_characters, "-", text.lower()).strip("-_.:") or "tune"
