"""RLlib's new API stack: environments with a curriculum, a module for them, and a callback for the curriculum's metrics.

run = sparring.Curriculum("http://127.0.0.1:8700", settings={"tasks": ["kessler/survival"]}).run
config = (
    PPOConfig()
    .environment(sparring.rllib.TEAM, env_config={"curriculum": {"url": "http://127.0.0.1:8700", "run": run}})
    .env_runners(num_env_runners=2, num_envs_per_env_runner=32, gym_env_vectorize_mode="vector_entry_point")
    .rl_module(rl_module_spec=sparring.rllib.module_spec("kessler/survival"))
    .callbacks(sparring.rllib.CurriculumCallback)
)
algorithm = config.build_algo()
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

try:
    from ray.rllib.callbacks.callbacks import RLlibCallback
    from ray.rllib.core import ALL_MODULES

    from .rllib_environments import AgentsEnv as AgentsEnv
    from .rllib_environments import TeamVectorEnv as TeamVectorEnv
    from .rllib_environments import agents_env as agents_env
    from .rllib_environments import open_curriculum, register_environments
    from .rllib_environments import team_env as team_env
    from .rllib_module import AgentsModule as AgentsModule
    from .rllib_module import module_spec as module_spec
    from .rllib_module import policy_fn as policy_fn
except ImportError as error:
    raise ImportError("sparring.rllib needs RLlib: pip install 'sparring[rllib]'") from error

from .curriculum import Curriculum, CurriculumError
from .trainer_metrics import TrainerReport

#: RLlib's name of `team_env`: one agent acts for a whole environment.
TEAM: str
#: RLlib's name of `agents_env`: a `MultiAgentEnv` with one agent per satellite or deputy.
AGENTS: str

# A checkpoint is loaded by name, without reading a constant.
register_environments()

if not TYPE_CHECKING:

    def __getattr__(name: str) -> str:
        """Returns `TEAM` or `AGENTS`, and registers the environments with a session of Ray that began after the import."""
        if name in ("TEAM", "AGENTS"):
            return register_environments()[name]
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


_EVALUATION_COUNTS = (
    "`evaluation_config` must have an env_config without a curriculum, because episodes of the algorithm's evaluation would "
    "count as training: config.evaluation(evaluation_interval=…, evaluation_config={'env_config': {'curriculum': None}}), or "
    "use sparring.evaluate"
)


class CurriculumCallback(RLlibCallback):
    """Sets the policy version of all env runners after each iteration, and adds the curriculum's metrics to the results.

    The version is the number of iterations, added to the newest version of the run. Results have `curriculum/…`:
    mastery, level, params, skill, the share of zero-variance groups, and the episode counts of all env runners. Episodes that
    the curriculum only measures are removed from the samples.

    The numbers of the learners (`learners/…`) and the mean return and length of episodes are sent to the curriculum's run with
    the number of iterations, at most once a second. A derived class with `report = False` does not send them.
    """

    #: True to send numbers of the learners to the server.
    report = True

    def __init__(self) -> None:
        super().__init__()
        # RLlib makes callbacks before environments, and a config of an earlier session has only their name.
        register_environments()
        self._curriculum: Curriculum | None = None
        self._report = TrainerReport(None)
        self._first_version = 0
        #: Ids of running episodes that are not learned from.
        self._excluded: set[str] = set()

    def on_algorithm_init(self, *, algorithm: Any, **_: Any) -> None:
        """Opens the curriculum of the env_config.

        Raises:
            ValueError: The algorithm evaluates in environments with a curriculum.
        """
        arguments = algorithm.config.env_config.get("curriculum")
        if algorithm.eval_env_runner_group is not None and algorithm.evaluation_config.env_config.get("curriculum"):
            # It returns the episodes that its env runners have leased.
            algorithm.cleanup()
            raise ValueError(_EVALUATION_COUNTS)
        if arguments is not None:
            # It runs no episodes: env runners have curricula of their own.
            self._curriculum = open_curriculum({name: arguments[name] for name in ("url", "run", "token") if name in arguments})
            self._report = TrainerReport(self._curriculum if self.report else None)
            self._start(algorithm, self._curriculum)

    def _start(self, algorithm: Any, curriculum: Curriculum) -> None:
        self._first_version = max(0, curriculum.policy_version - algorithm.iteration)
        _set_policy_version(algorithm, self._first_version + algorithm.iteration)

    def on_evaluate_start(self, *, algorithm: Any, **_: Any) -> None:
        """Rejects `algorithm.evaluate()` in the environments of the training, which have the curriculum.

        Raises:
            ValueError: The algorithm has no environments for evaluation.
        """
        if self._curriculum is not None and algorithm.eval_env_runner_group is None:
            raise ValueError(_EVALUATION_COUNTS)

    def on_train_result(self, *, algorithm: Any, result: dict[str, Any], **_: Any) -> None:
        """Sets the policy version, adds the metrics, and reports those of the learners."""
        if self._curriculum is None:
            return
        self._report.add(result["training_iteration"], _learner_metrics(result))
        stats = _set_policy_version(algorithm, self._first_version + result["training_iteration"])
        try:
            metrics = self._curriculum.metrics()
        except CurriculumError:
            # An unreachable server does not end the training.
            metrics = {}
        result["curriculum"] = {**metrics, **{f"episodes/{name}": value for name, value in stats.items()}}

    def on_checkpoint_loaded(self, *, algorithm: Any, **_: Any) -> None:
        """Sets the policy version to that of the checkpoint."""
        if self._curriculum is not None:
            self._start(algorithm, self._curriculum)

    def on_env_runners_recreated(self, *, algorithm: Any, **_: Any) -> None:
        """Sets the policy version of restarted env runners."""
        if self._curriculum is not None:
            _set_policy_version(algorithm, self._first_version + algorithm.iteration)

    def on_episode_start(self, *, episode: Any, **_: Any) -> None:
        """Excludes an episode that is not for training from learning."""
        if not _first_info(episode).get("train", True):
            self._excluded.add(episode.id_)

    def on_sample_end(self, *, env_runner: Any, samples: list[Any], **_: Any) -> None:
        """Removes episodes that are not learned from."""
        if self._excluded and not env_runner.config.in_evaluation:
            ended = {episode.id_ for episode in samples if episode.is_done}
            samples[:] = [episode for episode in samples if episode.id_ not in self._excluded]
            self._excluded -= ended


def _learner_metrics(result: Mapping[str, Any]) -> dict[str, object]:
    """Returns the results of each module's learner, and the mean return and length of episodes, by path."""
    episodes = result.get("env_runners", {})
    metrics = {f"env_runners/{name}": episodes.get(name) for name in ("episode_return_mean", "episode_len_mean")}
    for module, results in result.get("learners", {}).items():
        if module != ALL_MODULES:  # it has counts and timers
            metrics |= {f"learners/{module}/{name}": value for name, value in results.items()}
    return metrics


def _first_info(episode: Any) -> Mapping[str, Any]:
    infos = episode.get_infos(0)
    # All agents have the same info.
    first = next(iter(infos.values()), None) if infos else None
    return first if isinstance(first, Mapping) else infos or {}


def _set_policy_version(algorithm: Any, version: int) -> dict[str, float]:
    """Sets the policy version of all env runners; returns the sum of their episode counts."""
    total: dict[str, float] = {}
    for group in (algorithm.env_runner_group, algorithm.eval_env_runner_group):
        if group is not None:
            for stats in group.foreach_env_runner(functools.partial(_set_runner_version, version)):
                for name, value in stats.items():
                    # The duration of an outage is the longest of all runners; counts add up.
                    is_duration = name == "unreachable_s"
                    total[name] = max(total.get(name, 0.0), value) if is_duration else total.get(name, 0.0) + value
    return total


def _set_runner_version(version: int, env_runner: Any) -> dict[str, float]:
    runner_env = getattr(env_runner, "env", None)
    if runner_env is None:
        return {}
    is_team = isinstance(runner_env.unwrapped, TeamVectorEnv)
    envs = [runner_env] if is_team else getattr(runner_env, "envs", [])
    curricula: set[Curriculum | None] = {getattr(env.unwrapped, "curriculum", None) for env in envs}
    total: dict[str, float] = {}
    for curriculum in filter(None, curricula):
        curriculum.policy_version = version
        for name, value in curriculum.stats().items():
            if isinstance(value, (int, float)):
                total[name] = total.get(name, 0.0) + float(value)
    return total
