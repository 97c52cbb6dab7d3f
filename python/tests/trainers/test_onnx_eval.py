"""`sparring eval --policy onnx:FILE` measures the policy that was exported: its scores are those of its model in Python."""

import json
import re
import statistics
import subprocess

import pytest

pytest.importorskip("stable_baselines3")
pytest.importorskip("tract")
from conftest import BINARY, LONG_TESTS, needs_server
from curriculum_servers import local_curriculum
from documents import ROOT
from onnx_policies import FIXTURES, make, observe, rows
from stable_baselines3 import DQN, PPO, SAC
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import sparring
import sparring.sb3

#: Policies that the report adds.
BASELINES = ("frozen", "blind_panel")
MEASURES = ("score", "success", "skill", "lost", "fuel_used")
KESSLER = ("kessler-heldout-v1", ["kessler/survival", "kessler/eco_station", "kessler/rendezvous"])
#: The tasks of kessler have the same observations and actions, so that one of them shows the rest of a format.
SURVIVAL = KESSLER if LONG_TESTS else ("kessler-heldout-v1", ["kessler/survival"])
DOCKING = ("docking-heldout-v1", ["docking/single"])
#: Largest difference of a mean with continuous actions, absolute or relative: that of an episode or two. Rounding, which
#: differs from processor to processor, changes an action by 1e-7, which rarely decides about a satellite or its fuel. Discrete
#: actions are equal.
TOLERANCE = {"abs": 0.02, "rel": 0.005}
EXACT = {"abs": 1e-9, "rel": 1e-9}
#: Largest difference of most means with continuous actions.
MEDIAN_TOLERANCE = 1e-5


def run_eval(policy, suite):
    """Runs `sparring eval` on a policy; returns the ended process."""
    command = [BINARY, "eval", "--suite", suite, "--policy", policy, "--json"]
    return subprocess.run(command, capture_output=True, text=True, timeout=600)


def means(report, tasks):
    """Returns the means of the evaluated policy by task, part and measure."""
    return {
        (row["task"], row["part"], measure): row[measure] and row[measure]["mean"]
        for row in report
        if row["policy"] not in BASELINES and row["task"] in tasks
        for measure in MEASURES
    }


def write_suite(folder, name, tasks):
    """Writes the part of a built-in suite with some of its tasks; returns the file."""
    suite = json.loads((ROOT / "evaluation/suites" / f"{name}.json").read_text())
    suite["groups"] = [group for group in suite["groups"] if group["task"] in tasks]
    body = json.dumps({**suite, "hash": None}, separators=(",", ":")).removesuffix('"hash":null}')
    file = folder / f"{name}.json"
    # The program names the BLAKE3 hash of the bytes, for which Python would need a package.
    file.write_text(f'{body}\n"hash":""}}\n')
    error = run_eval("hold", file).stderr
    (found,) = re.findall(r"\b[0-9a-f]{64}\b", error)
    file.write_text(f'{body}\n"hash":"{found}"}}\n')
    return file


def compare(model, file, suite, normalize=None, **environment):
    """Compares the scores of a file with those of its model in environments of Python."""
    name, tasks = suite

    def act(observations):
        is_rows = len(model.observation_space.shape or ()) == 1
        flat = observations.reshape(-1, observations.shape[-1]) if is_rows else observations
        flat = normalize.normalize_obs(flat) if normalize else flat
        actions, _ = model.predict(flat, deterministic=True)
        return actions.reshape(*observations.shape[:2], *actions.shape[1:]) if is_rows else actions

    with local_curriculum(settings={"tasks": tasks}) as curriculum:
        result = sparring.evaluate(curriculum, act, suite=name, tasks=tasks, stochastic=False, **environment)
    ended = run_eval(f"onnx:{file}", write_suite(file.parent, name, tasks))
    assert ended.returncode == 0, ended.stderr
    expected, measured = means(result.rows, tasks), means(json.loads(ended.stdout)["rows"], tasks)
    assert expected.keys() == measured.keys()
    assert len(expected) == 3 * len(tasks) * len(MEASURES)
    is_discrete = environment.get("actions") in ("discrete", "few")
    assert measured == pytest.approx(expected, **(EXACT if is_discrete else TOLERANCE))
    differences = [abs(measured[key] - mean) for key, mean in expected.items() if mean is not None]
    assert len(differences) >= 10
    assert statistics.median(differences) <= MEDIAN_TOLERANCE


@needs_server
@pytest.mark.parametrize(("algorithm", "actions"), [(PPO, "continuous"), (SAC, "continuous"), (DQN, "discrete"), (PPO, "few")])
def test_rows_of_satellites_have_the_scores_of_the_model(algorithm, actions, tmp_path):
    envs = rows(actions=actions)
    model = make(algorithm, envs)
    sparring.export_onnx(model, tmp_path / "policy.onnx")
    compare(model, tmp_path / "policy.onnx", KESSLER if algorithm is SAC else SURVIVAL, actions=actions)


@needs_server
def test_extended_state_has_the_scores_of_the_model(tmp_path):
    settings = {"observation": "extended_state", "actions": "few"}
    model = make(PPO, rows("docking/single", **settings))
    sparring.export_onnx(model, tmp_path / "policy.onnx")
    compare(model, tmp_path / "policy.onnx", DOCKING, **settings)


@needs_server
def test_normalised_rows_have_the_scores_of_the_model(tmp_path):
    envs = VecNormalize(rows())
    model = make(PPO, envs)
    observe(model, envs)
    sparring.export_onnx(model, tmp_path / "policy.onnx")
    compare(model, tmp_path / "policy.onnx", SURVIVAL, normalize=envs)


@needs_server
def test_other_tracks_and_axes_have_the_scores_of_the_model(tmp_path):
    settings = {"threats": 3, "look_ahead": 25, "axes": "world"}
    model = make(PPO, rows(**settings))
    sparring.export_onnx(model, tmp_path / "policy.onnx")
    compare(model, tmp_path / "policy.onnx", SURVIVAL, **settings)


@needs_server
@pytest.mark.parametrize("actions", ["continuous", "discrete"])
def test_rows_of_deputies_have_the_scores_of_the_model(actions, tmp_path):
    envs = VecNormalize(rows("docking/single", actions=actions))
    model = make(PPO, envs)
    observe(model, envs)
    sparring.export_onnx(model, tmp_path / "policy.onnx")
    compare(model, tmp_path / "policy.onnx", DOCKING, normalize=envs, actions=actions)


@needs_server
@pytest.mark.parametrize("actions", ["continuous", "discrete"])
def test_telemetry_has_the_scores_of_the_model(actions, tmp_path):
    settings = {"observation": "telemetry", "bodies": 320, "actions": actions}
    envs = DummyVecEnv([lambda: sparring.Environment("kessler/survival", level=5, **settings)])
    model = make(PPO, envs, "MultiInputPolicy")
    sparring.export_onnx(model, tmp_path / "policy.onnx")
    compare(model, tmp_path / "policy.onnx", SURVIVAL, **settings)


@needs_server
def test_joint_policy_has_the_scores_of_the_model(tmp_path):
    model = make(PPO, sparring.Environment("kessler/survival", level=5))
    sparring.export_onnx(model, tmp_path / "policy.onnx")
    compare(model, tmp_path / "policy.onnx", SURVIVAL)


@needs_server
def test_file_without_metadata_has_the_default_settings(tmp_path):
    policies = [f"onnx:{FIXTURES}/faulty/no_metadata.onnx", "hold"]
    suite = write_suite(tmp_path, *SURVIVAL)
    reports = [json.loads(run_eval(policy, suite).stdout)["rows"] for policy in policies]
    of_file, of_hold = (means(report, SURVIVAL[1]) for report in reports)
    assert of_file == of_hold


@needs_server
def test_policy_of_another_world_is_rejected():
    ended = run_eval(f"onnx:{FIXTURES}/state_docking.onnx", KESSLER[0])
    assert ended.returncode == 2
    assert "docking@1" in ended.stderr


@needs_server
@pytest.mark.parametrize("fault", sorted({path.stem for path in FIXTURES.glob("faulty/*.onnx")} - {"no_metadata"}))
def test_faulty_file_is_named(fault):
    file = FIXTURES / "faulty" / f"{fault}.onnx"
    ended = run_eval(f"onnx:{file}", KESSLER[0])
    assert ended.returncode == 2, ended.stdout
    assert file.name in ended.stderr
    assert "panicked" not in ended.stderr
