"""Scenarios, brackets, critiques and policies are consistent with each other."""

import copy
import pickle

import numpy as np
import pytest
from conftest import random_actions

import sparring


def test_tasks_are_described():
    assert sparring.tasks() == list(sparring.ENVIRONMENTS.values())
    space = sparring.parameter_space("kessler/survival")
    assert (space["debris"].min, space["debris"].max, space["debris"].harder) == (0, 1000, "up")
    assert len(sparring.levels("survival")) == 10
    assert sparring.task("docking/single").agent_axes is None
    assert set(sparring.task("survival").policies) >= {"hold", "random", "blind", "frozen", "heuristic", "reference"}


def test_scenario_is_a_value():
    scenario = sparring.Scenario("survival", params={"debris": 40}, physics={"contact": "swept"}, seed=7)
    parsed = sparring.Scenario.from_dict(scenario.to_dict())
    assert scenario == parsed and hash(scenario) == hash(parsed) and scenario.id == parsed.id
    assert eval(repr(scenario), {"Scenario": sparring.Scenario}) == scenario
    assert pickle.loads(pickle.dumps(scenario)) == copy.deepcopy(scenario) == scenario
    assert scenario != sparring.Scenario("survival", params={"debris": 40}, seed=7)
    assert (scenario.task, scenario.seed, scenario.horizon, scenario.agents) == ("kessler/survival", 7, 50, 3)


@pytest.mark.parametrize("level", [0, 5])
def test_bracket_has_the_scores_of_its_plans(task, level):
    scenario = next(
        scenario for seed in range(50) if sparring.bracket(scenario := sparring.Scenario(task, level=level, seed=seed)).solvable
    )
    bracket = sparring.bracket(scenario)
    assert bracket.floor <= bracket.reference.score + 1e-9
    assert bracket.panel_successes == sum(outcome.success for outcome in bracket.panel)
    assert bracket.hold == bracket.panel[0].score == sparring.rollout(scenario, "hold")[0].score
    assert sparring.replay(scenario, bracket.reference_plan).score == bracket.reference.score
    assert sparring.rollout(scenario, "reference")[0].score == bracket.reference.score
    if bracket.skill(bracket.reference.score) is not None:
        assert bracket.skill(bracket.reference.score) == 1.0


def test_environment_score_equals_its_replay(task):
    env = sparring.Environment(task, level=2)
    rng = np.random.default_rng(1)
    for seed in range(3):
        env.reset(seed=seed)
        over = False
        while not over:
            *_, terminated, truncated, info = env.step(random_actions(env.action_space, rng, 1, scale=0.1)[0])
            over = terminated or truncated
        outcome = sparring.replay(env.scenario, env.history)
        assert outcome.score == info["score"] and outcome.steps == len(env.history)
        critique = sparring.critique(env.scenario, env.history)
        assert set(critique) == {"failures", "actions", "assessment"} and -1 <= critique["assessment"]["value"] <= 1


def test_policy_in_environment_equals_rollout(task):
    scenario = sparring.Scenario(task, level=1, seed=5)
    env = sparring.Environment(task, level=1, axes="world")
    for name in ("hold", "heuristic", "random"):
        outcome, _ = sparring.rollout(scenario, name, seed=3)
        env.reset(options={"scenario": scenario})
        policy, over = sparring.policy(name, scenario, seed=3), False
        while not over:
            *_, terminated, truncated, info = env.step(policy.act(env.telemetry()))
            over = terminated or truncated
        # A policy acts in double precision, the environment in single: the difference is small unless it decides a hit.
        assert info["score"] == pytest.approx(outcome.score, abs=0.02), name


def test_unknown_name_lists_the_known_ones():
    scenario = sparring.Scenario("survival")
    for call, expected in [
        (lambda: sparring.policy("none", scenario), "heuristic"),
        (lambda: sparring.rollout(scenario, "none"), "heuristic"),
        (lambda: sparring.task("none"), "kessler/survival"),
        (lambda: sparring.policy("hold", scenario).act({"satellites": 3}), "telemetry"),
        (lambda: sparring.replay(scenario, np.zeros((3, 3, 2))), "actions"),
        (lambda: sparring.replay(scenario, np.zeros((3, 3, 2)), stopped="tired"), "stopped"),
        (lambda: sparring.Scenario.from_json("{"), "scenario"),
    ]:
        with pytest.raises(ValueError, match=expected):
            call()
    assert sparring.replay(scenario, np.zeros((3, 3, 2)), stopped="too_late").steps == 50


def test_other_types_than_scenario_are_rejected():
    for function in (
        sparring.bracket,
        lambda scenario: sparring.critique(scenario, []),
        lambda scenario: sparring.replay(scenario, []),
        sparring.rollout,
    ):
        with pytest.raises(ValueError, match=r"^`scenario` must "):
            function("kessler/survival")
    assert len(repr(sparring.bracket(sparring.Scenario("survival", seed=1)))) < 4000


def test_skill_of_nan_is_rejected():
    bracket = sparring.bracket(sparring.Scenario("survival", level=9, seed=3))
    with pytest.raises(ValueError, match="score"):
        bracket.skill(float("nan"))
