"""Scenarios, brackets, critiques and policies, against each other and against what the project recorded."""

import copy
import pickle

import numpy as np
import pytest

import sparring


def test_tasks_as_data():
    assert sparring.tasks() == list(sparring.ENVIRONMENTS.values())
    space = sparring.parameter_space("kessler/survival")
    assert (space["debris"].min, space["debris"].max, space["debris"].harder) == (0, 1000, "up")
    assert len(sparring.levels("survival")) == 10
    assert sparring.task("docking/single").agent_axes is None
    assert set(sparring.task("survival").policies) >= {"hold", "random", "blind", "frozen", "heuristic", "reference"}


def test_a_scenario_is_a_value():
    scenario = sparring.Scenario("survival", params={"debris": 40}, physics={"contact": "swept"}, seed=7)
    again = sparring.Scenario.from_dict(scenario.to_dict())
    assert scenario == again and hash(scenario) == hash(again) and scenario.id == again.id
    assert eval(repr(scenario), {"Scenario": sparring.Scenario}) == scenario
    assert pickle.loads(pickle.dumps(scenario)) == copy.deepcopy(scenario) == scenario
    assert scenario != sparring.Scenario("survival", params={"debris": 40}, seed=7)
    assert (scenario.task, scenario.seed, scenario.horizon, scenario.agents) == ("kessler/survival", 7, 50, 3)


@pytest.mark.parametrize("level", [0, 5])
def test_a_bracket_is_what_its_plans_earn(task, level):
    scenario = next(
        scenario for seed in range(50) if sparring.bracket(scenario := sparring.Scenario(task, level=level, seed=seed)).solvable
    )
    bracket = sparring.bracket(scenario)
    assert bracket.floor <= bracket.reference.score + 1e-9
    assert bracket.panel_success == sum(flown.success for flown in bracket.panel)
    assert bracket.hold == bracket.panel[0].score == sparring.fly(scenario, "hold")[0].score
    assert sparring.replay(scenario, bracket.witness).score == bracket.reference.score
    assert sparring.fly(scenario, "reference")[0].score == bracket.reference.score
    if bracket.skill(bracket.reference.score) is not None:
        assert bracket.skill(bracket.reference.score) == 1.0


def test_an_environment_earns_what_its_log_replays_to(task):
    env = sparring.Environment(task, level=2)
    env.action_space.seed(1)
    for seed in range(3):
        env.reset(seed=seed)
        over = False
        while not over:
            *_, terminated, truncated, info = env.step(env.action_space.sample() * np.float32(0.1))
            over = terminated or truncated
        flown = sparring.replay(env.scenario, env.history)
        assert flown.score == info["score"] and flown.steps == len(env.history)
        shown = sparring.critique(env.scenario, env.history)
        assert set(shown) == {"failures", "actions", "judged"} and -1 <= shown["judged"]["value"] <= 1


def test_policies_fly_environments_as_they_fly_by_themselves(task):
    scenario = sparring.Scenario(task, level=1, seed=5)
    env = sparring.Environment(task, level=1, axes="world")
    for name in ("hold", "heuristic", "random"):
        alone, _ = sparring.fly(scenario, name, seed=3)
        env.reset(options={"scenario": scenario})
        pilot, over = sparring.policy(name, scenario, seed=3), False
        while not over:
            *_, terminated, truncated, info = env.step(pilot.act(env.telemetry()))
            over = terminated or truncated
        # A policy acts in double precision, the environment takes single: what comes of 1e-8 is small but where somebody is hit.
        assert info["score"] == pytest.approx(alone.score, abs=0.02), name


def test_what_is_unknown_is_refused_with_what_there_is():
    scenario = sparring.Scenario("survival")
    for call, words in [
        (lambda: sparring.policy("none", scenario), "heuristic"),
        (lambda: sparring.fly(scenario, "none"), "heuristic"),
        (lambda: sparring.task("none"), "kessler/survival"),
        (lambda: sparring.policy("hold", scenario).act({"satellites": 3}), "telemetry"),
        (lambda: sparring.replay(scenario, np.zeros((3, 3, 2))), "actions"),
        (lambda: sparring.replay(scenario, np.zeros((3, 3, 2)), stopped="tired"), "stopped"),
        (lambda: sparring.Scenario.from_json("{"), "scenario"),
    ]:
        with pytest.raises(ValueError, match=words):
            call()
    assert sparring.replay(scenario, np.zeros((3, 3, 2)), stopped="too_late").steps == 50


def test_what_is_no_scenario():
    for what in (sparring.bracket, lambda one: sparring.critique(one, []), lambda one: sparring.replay(one, []), sparring.fly):
        with pytest.raises(ValueError, match=r"^scenario: "):
            what("kessler/survival")
    assert len(repr(sparring.bracket(sparring.Scenario("survival", seed=1)))) < 4000


def test_a_score_that_is_none_has_no_skill():
    bracket = sparring.bracket(sparring.Scenario("survival", level=9, seed=3))
    with pytest.raises(ValueError, match="score"):
        bracket.skill(float("nan"))
