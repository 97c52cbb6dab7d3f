"""Evaluations on held-out suites of a real server."""

import numpy as np
import pytest
from conftest import needs_server
from curriculum_servers import hold_to_end, local_curriculum

import sparring

pytestmark = needs_server


def begin_evaluation(curriculum, **settings):
    """Begins an evaluation; returns its number of episodes and the curriculum that runs them."""
    body = {"run": curriculum.run, "policy": "hold", "tasks": ["kessler/survival"], **settings}
    evaluation = curriculum.request("POST", "/v1/evaluations", body)
    total = evaluation["scenarios"] * evaluation["rollouts"]
    return total, curriculum.reopen(purpose="eval", evaluation=evaluation["id"])


def test_suite_of_another_world_is_rejected():
    settings = {"tasks": ["docking/single"], "placement": False, "design": {"designer": "off"}}
    with local_curriculum(settings=settings, form="groups") as curriculum:

        def hold(observations):
            return np.zeros((len(observations), 1, 3), np.float32)

        with pytest.raises(ValueError, match=r"`suite` must .* kessler-heldout-v2 has kessler/.*, the run has docking/single"):
            sparring.evaluate(curriculum, hold, suite="kessler-heldout-v2")
        with pytest.raises(ValueError, match="`policy` must not be 'blind_panel'"):
            sparring.evaluate(curriculum, hold, policy="blind_panel")
        with pytest.raises(ValueError, match="autoreset_mode"):
            sparring.evaluate(curriculum, hold, autoreset_mode="disabled")
        result = sparring.evaluate(curriculum, hold, policy="hold", stochastic=False)
        assert {row["task"] for row in result.rows} <= {"all", "docking/single"}
        assert result.mean("docking/single", "score", "all") is not None


def test_actions_are_repeated_between_decisions():
    calls = []

    def act(observations):
        calls.append(observations)
        return np.zeros((len(observations), 1), np.int64)

    settings = {"tasks": ["docking/single"], "placement": False, "design": {"designer": "off"}}
    with local_curriculum(settings=settings, form="groups") as curriculum:
        with pytest.raises(ValueError, match="`decision_steps` must be an integer >= 1, got 0"):
            sparring.evaluate(curriculum, act, decision_steps=0)
        held_out = {"observation": "extended_state", "actions": "few", "rollouts": 1}
        scores = []
        for steps in (1, 5):
            calls.clear()
            result = sparring.evaluate(curriculum, act, decision_steps=steps, policy=f"hold{steps}", **held_out)
            scores.append((result.mean("docking/single", "score", "all"), len(calls)))
    assert all(observations.shape[1:] == (1, 20) for observations in calls)
    assert scores[0][0] == pytest.approx(scores[1][0]), "an agent that holds does so however often it decides"
    assert 0.15 * scores[0][1] < scores[1][1] < 0.5 * scores[0][1]


def test_evaluation_of_a_failing_policy_is_cancelled():
    def act(observations):
        raise RuntimeError("no policy")

    with local_curriculum() as curriculum:
        with pytest.raises(RuntimeError, match="no policy"):
            sparring.evaluate(curriculum, act)
        evaluations = curriculum.request("GET", "/v1/evaluations")["evaluations"]
        assert [(row["state"], "cancelled" in row["error"]) for row in evaluations] == [("failed", True)]


def test_reset_during_an_evaluation_skips_no_scenario():
    with local_curriculum() as curriculum:
        total, held_out = begin_evaluation(curriculum)
        with held_out:
            envs = sparring.make_vec(num_envs=64, curriculum=held_out)
            envs.reset()
            ended = 0
            while not envs.idle.all():
                *_, infos = envs.step(np.zeros(envs.action_space.shape, np.float32))
                if "_episode" in infos:
                    ended += int(infos["_episode"].sum())
                    # No episode is left except the running ones: these begin again, twice.
                    if held_out.stats()["ready"] == 0 and total - 8 < ended < total - 4:
                        envs.reset()
                        assert not envs.idle.all()
                        assert (envs.idle.sum()) == 64 - (total - ended)
            envs.close()
            assert ended == total
            with pytest.raises(sparring.CurriculumError, match="no episode is left: the evaluation is complete"):
                sparring.make_vec(curriculum=held_out)


def test_single_environments_run_a_whole_evaluation():
    with local_curriculum() as curriculum:
        total, held_out = begin_evaluation(curriculum, rollouts=1)
        with held_out:
            single = sparring.Environment(curriculum=held_out)
            parallel = sparring.parallel_env(curriculum=held_out)
            for env, episodes in ((single, total // 2), (parallel, total - total // 2)):
                for _ in range(episodes):
                    env.reset()
                    hold_to_end(env)
                if env is parallel:
                    with pytest.raises(sparring.CurriculumError, match="no episode is left"):
                        env.reset()
                env.close()
            assert held_out.stats()["finished"] == total
