"""The evidence runs: statistics against closed forms, and a small version in which only the curriculum learns."""

import csv
import dataclasses
import json
import pathlib
import re
import shlex
import sys

import numpy as np
import pytest
from conftest import BINARY, LONG_TESTS, needs_server
from documents import printed_command, run_command

pytest.importorskip("torch")
pytest.importorskip("scipy")

import sparring
from sparring.experiments import ppo
from sparring.experiments.evidence import cli, held_out, protocol, report, runner, statistics, training
from sparring.experiments.evidence.statistics import Outcome
from sparring.experiments.evidence.training import Training
from sparring.experiments.experiment import ExperimentError

TASK = "docking/single"
EVIDENCE_COMMAND = "python -m sparring.experiments evidence"
REPOSITORY = pathlib.Path(__file__).parents[3]


def outcome(seed, values, arm="auto", budget=1000):
    problem = dataclasses.replace(protocol.find_problem(TASK), budget=budget)
    steps = np.linspace(0.0, budget, len(values))
    final = {"success": values[-1], "skill": values[-1], "worst_tenth": 0.0}
    return Outcome(Training(TASK, arm, seed), problem, steps, np.array(values), final, None)


def write_results(folder, training, budget=1000, **changes):
    """Writes the results of a complete training."""
    results = {
        "problem": training.problem,
        "arm": training.arm,
        "seed": training.seed,
        "budget": budget,
        "curve": [{"steps": steps, "success": 0.0, "skill": 0.0} for steps in (0, budget)],
        "final": {"success": 0.0, "skill": 0.0, "worst_tenth": 0.0},
        "zero_variance": None,
    }
    file = training.file(folder)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps({**results, **changes}))


def test_threshold_needs_two_evaluations():
    assert outcome(1, [0.0, 0.9, 0.1, 0.6, 0.8]).steps_to(0.7) == 750.0
    assert outcome(1, [0.0, 0.8, 0.1, 0.2, 0.3]).steps_to(0.7) is None
    assert outcome(1, [0.0, 0.8, 0.1, 0.2, 0.3]).steps_or_budget(0.7) == 1000.0
    assert outcome(1, [0.0, 1.0, 0.0]).area() == pytest.approx(0.5)


def test_ratio_pairs_seeds_and_counts_misses_as_the_budget():
    fast = [outcome(seed, [0.0, 1.0, 1.0, 1.0, 1.0]) for seed in (1, 2, 3)]
    slow = [outcome(seed, [0.0, 0.0, 0.0, 0.0, 0.0]) for seed in (3, 2, 1, 9)]
    # The first two evaluations have a mean of 0.5, and the baseline never reaches it.
    assert statistics.ratio_of_steps(fast, slow, 0.6).mean == pytest.approx(1000 / 250)
    area = statistics.relative_area(fast[:2], [outcome(1, [0.5] * 5), outcome(2, [0.25] * 5)])
    assert area.mean == pytest.approx((0.875 * 2 - 0.75) / 0.75)
    assert statistics.relative_area(fast, [outcome(1, [0.0] * 5)]) is None
    assert statistics.ratio_of_steps(fast, [outcome(9, [0.0] * 5)], 0.6) is None
    interval = statistics.mean([1.0, 2.0, 3.0, 4.0])
    assert interval.low < 2.5 == interval.mean < interval.high


def test_curves_with_other_evaluations_are_drawn(tmp_path):
    outcomes = [outcome(1, [0.0, 0.5, 1.0]), outcome(2, [0.0, 0.2, 0.4, 1.0])]
    report._draw(outcomes[0].problem, outcomes, tmp_path / "curves.svg")
    assert (tmp_path / "curves.svg").stat().st_size > 5_000


def test_report_continues_from_the_tables_of_an_earlier_one(tmp_path):
    earlier = REPOSITORY / "docs/evidence"
    tables = (statistics.TRAININGS_FILE, statistics.CURVES_FILE)
    for name in tables:
        (tmp_path / name).write_text((earlier / name).read_text())
    first, *others = runner.planned(["docking/single"], ["auto"])
    write_results(tmp_path, first, budget=4_000_000)
    assert runner.missing(tmp_path, [first, *others]) == []
    # A file of results replaces the rows of its training.
    measured = [each.values[-1] > 0 for each in statistics.read(tmp_path) if each.training in (first, *others)]
    assert measured == [False] + [True] * len(others)
    first.file(tmp_path).unlink()
    report.write(tmp_path)
    for name in tables:
        assert (tmp_path / name).read_text() == (earlier / name).read_text()


def test_designs_are_compared_with_their_control(tmp_path):
    designs = [outcome(seed, [0.0, value]) for seed, value in ((1, 0.7), (2, 0.5), (8, 0.0))]
    control = [outcome(seed, [0.0, value]) for seed, value in ((2, 0.4), (1, 0.5))]
    change = statistics.difference(designs, control, "success")
    assert change.mean == pytest.approx(0.15)
    assert change.low == pytest.approx(0.1) and change.high == pytest.approx(0.2)
    assert statistics.difference(designs, control, "worst_tenth").mean == 0.0
    assert statistics.difference(designs, [], "success") is None
    for arm, outcomes in ((protocol.DESIGNS_ARM, designs), (protocol.CONTROL_ARM, control)):
        for each in outcomes:
            write_results(tmp_path, Training(TASK, arm, each.training.seed), final=each.final)
    report.write(tmp_path)
    row = next(line for line in (tmp_path / "report.md").read_text().splitlines() if line.startswith(f"| {TASK} |"))
    assert row.startswith(f"| {TASK} | 2 | +0.000 [+0.000, +0.000] | +0.150 ["), "seed 8 has no control"
    assert protocol.find_arm(protocol.DESIGNS_ARM).run_settings(TASK, 101)["design"] == {"designer": "procedural"}
    assert protocol.find_arm(protocol.CONTROL_ARM).run_settings(TASK, 101)["design"] == {"designer": "off"}


def test_aimed_failure_is_that_of_the_most_designed_episodes(tmp_path):
    shares = {1: ({"crash": 0.3, "timeout": 0.2}, {"crash": 0.5, "timeout": 0.1}), 2: ({"timeout": 0.4}, {"crash": 0.2})}
    aimed = {1: {"crash": 40, "timeout": 9}, 2: {"crash": 3, "timeout": 30}}
    designs, control = [], []
    for seed, (own, other) in shares.items():
        designs.append(dataclasses.replace(outcome(seed, [0.0, 0.5]), failures=own, aimed=aimed[seed]))
        control.append(dataclasses.replace(outcome(seed, [0.0, 0.5]), failures=other))
    # Seed 1 aims at crashes, 0.3 − 0.5; seed 2 at timeouts, which its control does not have: 0.4 − 0.
    assert statistics.aimed_failure_difference(designs, control).mean == pytest.approx(0.1)
    assert statistics.aimed_failure_difference(designs[:1], control).mean == pytest.approx(-0.2)
    unmeasured = [dataclasses.replace(each, failures=None) for each in control]
    assert statistics.aimed_failure_difference(designs, unmeasured) is None
    for arm, outcomes in ((protocol.DESIGNS_ARM, designs), (protocol.CONTROL_ARM, control)):
        for each in outcomes:
            training_ = Training(TASK, arm, each.training.seed)
            write_results(tmp_path, training_, final=each.final, failures=each.failures, aimed=each.aimed)
    report.write(tmp_path)
    assert "| +0.100 [-0.200, +0.400] | crash (1), timeout (1) |" in (tmp_path / "report.md").read_text()


def test_worst_tenth_is_ranked_by_other_episodes():
    skill = np.zeros((8, 20))
    skill[::2, :2] = -1.0  # the ranking episodes of two scenarios are bad by chance
    measured = held_out.Measured(skill > 0.5, skill)
    assert measured.worst_tenth("skill") == 0.0
    skill[1::2, :2] = -0.5
    assert held_out.Measured(skill > 0.5, skill).worst_tenth("skill") == -0.5


def test_ramp_climbs_all_rungs_before_three_quarters():
    scales = [protocol.ramp(TASK, share) for share in (0.0, 0.375, 0.74, 0.75, 1.0)]
    column = scales[0]["columns"].index("start_scale")
    assert [table["rows"][0][column] for table in scales] == pytest.approx([0.01, 0.1166, 1.0, 1.0, 1.0], rel=0.01)
    assert all(len(table["rows"]) == 10 for table in scales)
    levels = [protocol.ramp("kessler/survival", share)["rows"] for share in (0.0, 0.4, 0.8)]
    assert [len(rows) for rows in levels] == [1, 1, 10]


def test_planned_trainings_begin_with_the_claims():
    trainings = runner.planned()
    first = [problem for problem in protocol.PROBLEMS if problem.learner == "ppo"]
    assert len(first) == 8
    assert len(trainings) == len(first) * (3 * 10 + 10 * 5) + (4 + 2 + 2) * 5
    assert {each.arm for each in trainings[: len(first) * 30]} == set(protocol.CLAIMED)
    assert {each.seed for each in runner.planned(["docking/single-sb3"])} == {101, 102, 103, 104, 105}
    assert len(runner.planned([TASK], ["auto"], [101, 102])) == 2


def test_groups_belong_to_the_problem_and_the_target_to_the_arm():
    groups, single = (protocol.find_problem(f"kessler/survival{name}") for name in ("-groups", ""))
    settings = groups.run_settings(protocol.find_arm("ladder"), 101)
    assert (settings["group_size"], settings["target"], settings["strategy"]) == (8, "half", "ladder")
    assert "target" not in groups.run_settings(protocol.find_arm("auto"), 101)
    assert single.run_settings(protocol.find_arm("auto"), 101)["group_size"] == 1
    assert single.run_settings(protocol.find_arm("plr"), 101)["group_size"] == 4


def test_protocol_page_has_the_numbers_of_the_code():
    page = (REPOSITORY / "docs/reference/evidence-protocol.md").read_text()
    for problem in protocol.PROBLEMS:
        row = next(line for line in page.splitlines() if line.startswith(f"| `{problem.name}`"))
        thresholds = ", ".join(f"{threshold:g}" if threshold else "0.0" for threshold in problem.thresholds)
        assert f"| {problem.budget:,}".replace(",", " ") + f" | {problem.measure} | {thresholds} |" in row
    assert all(f"`{arm.name}`" in page for arm in protocol.ARMS)


SEEDS = ", ".join(map(str, range(101, 111)))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--problems none", "--problems must be among docking/single, docking/single-success, .*, got 'none'"),
        ("--problems ,", "--problems must be among docking/single, .*, got ','"),
        ("--arms auto,none", "--arms must be among uniform-levels, .*, ladder, got 'none'"),
        ("--arms ''", "--arms must be among uniform-levels, .*, ladder, got ''"),
        ("--seeds 7", f"--seeds must be among {SEEDS}, which no tuning used, got '7'"),
        ("--seeds x", f"--seeds must be among {SEEDS}, which no tuning used, got 'x'"),
        ("--seeds ''", f"--seeds must be among {SEEDS}, which no tuning used, got ''"),
        ("--jobs 0", "--jobs must be >= 1, got 0"),
        ("--budget 0", "--budget must be >= 1, got 0"),
        (
            "--arms plr --problems kessler/survival-groups",
            "--arms must be among uniform-levels, contested, auto, ladder for kessler/survival-groups, got 'plr'",
        ),
        (
            "--arms plr --seeds 108,109",
            "--seeds must be among 101, 102, 103, 104, 105 with plr for all problems, got '108,109'",
        ),
        ("--report", "--out must have a complete training, got .*"),
    ],
)
def test_invalid_option_is_reported_in_one_line(options, message, tmp_path, capsys):
    assert cli.main(["--out", str(tmp_path), *shlex.split(options)]) == 2
    assert re.fullmatch(message + "\n", capsys.readouterr().err)


def test_printed_commands_plan_trainings(tmp_path, monkeypatch):
    planned = {}

    def run(folder, trainings, *_):
        planned[folder] = trainings
        raise ExperimentError("nothing is run")

    monkeypatch.setattr(runner, "run", run)
    for page, arms, seeds in (
        ("docs/guides/choose-a-curriculum.md", {"uniform-levels", "auto"}, {101, 102, 103}),
        ("docs/reference/evidence-protocol.md", {arm.name for arm in protocol.ARMS}, set(protocol.SEEDS)),
        ("docs/reference/evidence-results.md", {"uniform-levels", "uniform-rungs", "auto"}, set(protocol.SEEDS)),
    ):
        folder = tmp_path / page
        command = printed_command(page, EVIDENCE_COMMAND, {"--out evidence": f"--out {folder}"})
        assert cli.main(shlex.split(command.removeprefix(EVIDENCE_COMMAND))) == 2
        assert {each.arm for each in planned[folder]} == arms
        assert {each.seed for each in planned[folder]} == seeds
    assert [len(trainings) for trainings in planned.values()] == [6, len(runner.planned()), 30]


def test_trainings_with_other_budgets_are_refused_and_kept(tmp_path, capsys):
    trial = Training(TASK, "auto", 101)
    write_results(tmp_path, trial, budget=600)
    before = trial.file(tmp_path).read_bytes()
    planned = runner.planned([TASK], ["auto", "fixed"], [101])
    assert runner.missing(tmp_path, planned, 600) == [Training(TASK, "fixed", 101)]
    assert len(runner.missing(tmp_path, runner.planned(["docking/single-sb3"]))) == 10, "another problem"
    for options, budget in (([], 4_000_000), (["--budget", "700"], 700), (["--arms", "fixed"], 4_000_000)):
        assert cli.main(["--out", str(tmp_path), "--problems", TASK, *options]) == 2
        assert capsys.readouterr().err == (
            f"--out must have no training of {TASK} with another budget than {budget} steps, "
            f"got {trial.file(tmp_path)} with 600: choose another folder\n"
        )
    assert trial.file(tmp_path).read_bytes() == before
    write_results(tmp_path, Training(TASK, "fixed", 101), budget=900)
    assert cli.main(["--out", str(tmp_path), "--report"]) == 2
    assert capsys.readouterr().err.startswith(f"--out must have trainings of {TASK} with one budget, got 600 and 900 steps")


def test_small_budget_is_evaluated_after_each_rollout(monkeypatch):
    problem = dataclasses.replace(protocol.find_problem(TASK), budget=protocol.LOOKS - 1)
    skill = np.zeros((1, 10))
    monkeypatch.setattr(training, "measure", lambda *_: held_out.Measured(skill > 0.5, skill))
    monitor = training._Monitor(problem, protocol.find_arm("auto"), None, None)
    for steps in (2, 2, 5, problem.budget):
        monitor.after_rollout(steps, None, {})
    assert [look["steps"] for look in monitor.curve] == [2, 5, problem.budget]


def test_held_out_flights_are_those_of_single_environments(tmp_path):
    scenarios = held_out.load(tmp_path, "docking/multiagent", 10, 1)
    assert held_out.load(tmp_path, "docking/multiagent", 10, 1).scenarios == scenarios.scenarios
    assert [row["level"] for row in json.loads((tmp_path / "docking-multiagent.json").read_text())] == list(range(10))
    config = ppo.Config.tuned("docking/multiagent")
    envs = sparring.make_vec("docking/multiagent", 1, **ppo.environment_settings(config))
    policy = ppo.Policy(envs.single_observation_space.shape[-1], 13, config)
    policy.sample = policy.act  # most likely actions do not depend on the order of flights
    measured = held_out.measure(policy, scenarios, 1, 1)
    for number, scenario in enumerate(scenarios.scenarios):
        single = sparring.make_vec("docking/multiagent", 1, autoreset_mode="disabled", params=scenario.params,
                                   **ppo.environment_settings(config))  # fmt: skip
        observations, over = single.reset(options={"scenario": scenario})[0], False
        while not over:
            observations, _, terminations, truncations, infos = single.step(policy.act(observations), repeat=5)
            over = bool(terminations[0] or truncations[0])
        score = infos["episode"]["r"][0]
        gap = scenarios.references[number] - scenarios.floors[number]
        assert measured.skill[0, number] == pytest.approx(np.clip((score - scenarios.floors[number]) / gap, -1, 1), abs=1e-6)


@needs_server
def test_printed_command_learns_from_groups(tmp_path):
    shorter = {"--arms uniform-levels,auto": "--arms ladder"}
    command = printed_command("docs/guides/train-own-loop.md", EVIDENCE_COMMAND, shorter)
    run_command(command, tmp_path, "--budget", "20000", "--binary", BINARY)
    results = json.loads((tmp_path / "groups/trainings/kessler-survival-groups/ladder-101.json").read_text())
    # Half of the episodes succeed at the level of the learner, so a short training may have no group without variance.
    assert results["complete_groups"] > 20 and 0.0 <= results["zero_variance"] < 0.5
    assert results["curve"][-1]["steps"] >= 20_000
    report = (tmp_path / "groups/report.md").read_text()
    assert f"| {results['zero_variance']:.2f} |" in report


@needs_server
def test_second_learner_trains_by_the_same_protocol(tmp_path):
    pytest.importorskip("stable_baselines3")
    options = ["--problems", "kessler/survival-sb3", "--arms", "auto", "--seeds", "101", "--budget", "12800"]
    assert cli.main([*options, "--binary", BINARY, "--out", str(tmp_path)]) == 0
    results = json.loads((tmp_path / "trainings/kessler-survival-sb3/auto-101.json").read_text())
    assert [look["steps"] for look in results["curve"]] == [6400, 12800]
    assert -1.0 <= results["final"]["skill"] <= 1.0
    assert 0.0 < results["failures"]["collision"] <= 1.0 and results["aimed"] == {}
    assert results["versions"]["stable-baselines3"] != "none"


def test_missing_package_of_a_learner_is_reported(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "sparring.experiments.sb3_ppo", None)
    monkeypatch.setitem(sys.modules, "sparring.sb3", None)
    monkeypatch.delattr("sparring.experiments.sb3_ppo", raising=False)
    assert cli.main(["--out", str(tmp_path), "--problems", "docking/single-sb3"]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith("--problems docking/single-sb3:")


@needs_server
def test_only_the_curriculum_learns_from_success_alone(tmp_path):
    seeds = ("101", "102", "103") if LONG_TESTS else ("101",)
    options = ["--problems", "docking/single-success", "--arms", "uniform-levels,auto", "--seeds", ",".join(seeds)]
    options += ["--budget", "600000", "--jobs", "2", "--binary", BINARY, "--out", str(tmp_path)]
    assert cli.main(options) == 0
    with (tmp_path / "trainings.csv").open() as file:
        success = {(row["arm"], row["seed"]): float(row["success"]) for row in csv.DictReader(file)}
    assert len(success) == 2 * len(seeds)
    for seed in seeds:
        assert success["uniform-levels", seed] < 0.05 < 0.2 < success["auto", seed]
    assert f"| auto | {len(seeds)} |" in (tmp_path / "report.md").read_text()
    assert (tmp_path / "docking-single-success.svg").stat().st_size > 10_000
    assert runner.missing(tmp_path, runner.planned(["docking/single-success"], ["auto"], [101]), 600_000) == []
