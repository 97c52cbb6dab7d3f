"""Numbers of RLlib's learners that reach the run of their curriculum, on a real server. Run as test_rllib.py."""

import pytest
from conftest import needs_server
from curriculum_servers import wait_until

pytest.importorskip("ray")
from test_rllib import cluster, local_curriculum, team_config  # noqa: F401

import sparring
import sparring.rllib


class SilentCallback(sparring.rllib.CurriculumCallback):
    """Callback that sends no numbers of the learners to the server."""

    report = False


def train(curriculum, callback, iterations):
    """Trains in this process."""
    config = team_config(curriculum, envs=2, steps=51).callbacks(callback)
    algorithm = config.env_runners(num_env_runners=0).build_algo()
    try:
        return [algorithm.train() for _ in range(iterations)]
    finally:
        algorithm.stop()


def logged_steps(curriculum):
    """Returns the steps of the trainer's metrics by name."""
    curves = curriculum.request("GET", f"/v1/runs/{curriculum.run}/metrics")["metrics"]
    return {curve["name"]: curve["step"] for curve in curves}


@needs_server
def test_numbers_of_the_learners_reach_the_run(cluster):  # noqa: F811
    with local_curriculum(["kessler/survival"]) as curriculum:
        train(curriculum, sparring.rllib.CurriculumCallback, 2)
        wait_until(lambda: logged_steps(curriculum))
        logged = logged_steps(curriculum)
        print(sorted(logged))
        assert {"learners/default_policy/total_loss", "env_runners/episode_return_mean"} <= logged.keys()
        assert not any("__all_modules__" in name for name in logged)
        assert logged["learners/default_policy/total_loss"][0] == 1


@needs_server
def test_derived_callback_leaves_the_server_out(cluster):  # noqa: F811
    with local_curriculum(["kessler/survival"]) as curriculum:
        results = train(curriculum, SilentCallback, 1)
        assert "kessler/survival/level" in results[-1]["curriculum"]
        assert logged_steps(curriculum) == {}
