"""Errors of ONNX exports name the argument; the package is imported without torch and onnx."""

import subprocess
import sys

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
pytest.importorskip("tract")
import torch
from conftest import needs_server
from curriculum_servers import local_curriculum
from onnx_policies import make, metadata, rows
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecFrameStack, VecNormalize
from torch import nn

import sparring
import sparring.sb3
from sparring.experiments import ppo


@pytest.fixture
def file(tmp_path):
    return tmp_path / "policy.onnx"


@pytest.fixture(scope="module")
def model():
    return make(PPO, rows(envs=1))


def linear(inputs=72, outputs=2):
    return nn.Linear(inputs, outputs)


class Branch(nn.Module):
    """Network with a branch that depends on values."""

    def forward(self, rows):
        return rows[:, :2] if rows.abs().sum() > 1e9 or len(rows) == 3 else -rows[:, :2]


class Choice(nn.Module):
    """Network that returns choices instead of logits."""

    def forward(self, rows):
        return rows[:, :17].argmax(dim=1, keepdim=True).repeat(1, 17)


class Pair(nn.Module):
    """Network that returns two outputs."""

    def forward(self, rows):
        return rows[:, :17], rows[:, :17]


class Noise(nn.Module):
    """Network whose actions are random."""

    def forward(self, rows):
        return rows[:, :2] + torch.rand_like(rows[:, :2])


class Fourier(nn.Module):
    """Network with an operator that ONNX does not have."""

    def forward(self, rows):
        return torch.linalg.eigvalsh(rows[:, :4].reshape(-1, 2, 2))


class Infinite(nn.Module):
    """Network whose actions are not numbers."""

    def forward(self, rows):
        return rows[:, :2] / 0.0 - rows[:, :2] / 0.0


@pytest.mark.parametrize(
    ("module", "message"),
    [
        (object(), "`model` must be an algorithm of Stable-Baselines3, a sparring.experiments.ppo.Policy or a torch.nn.Module"),
        (linear(70), r"`model` must map observations \[rows, 72\] to actions \[rows, 2\], got an error: .*mat1 and mat2"),
        (linear(72, 3), r"`model` must (map|return)"),
        (Noise(), "`model` must compute the same as its ONNX graph"),
        (Branch(), "`model` must compute the same as its ONNX graph"),
        (Fourier(), "`model` must consist of operators of ONNX opset 17"),
        (Infinite(), "`model` must return finite actions"),
        (ppo.Policy(65, 2, ppo.Config()), r"`model` must be trained on observations of the shape \(72,\)"),
        (ppo.Policy(72, 3, ppo.Config()), "`model` must be trained on the actions of `envs`"),
    ],
)
@pytest.mark.filterwarnings("ignore")
def test_invalid_model_is_described(module, message, file):
    with pytest.raises(ValueError, match=message):
        sparring.export_onnx(module, file, envs=sparring.make_vec("kessler/survival", 2))
    assert not list(file.parent.iterdir())


@pytest.mark.parametrize(("module", "found"), [(Choice(), "torch.int64"), (Pair(), "tuple"), (linear(72, 17).double(), "error")])
def test_output_of_another_type_is_described(module, found, file):
    with pytest.raises(ValueError, match=f"`model` must .*got .*{found}"):
        sparring.export_onnx(module, file, envs=sparring.make_vec("kessler/survival", 2, actions="discrete"))


@pytest.mark.parametrize(
    ("envs", "message"),
    [
        (lambda: "survival", "`envs` must be environments of sparring"),
        (lambda: gymnasium.make("CartPole-v1"), "`envs` must be environments of sparring"),
        (lambda: VecFrameStack(rows(envs=1), 2), "`envs` must have no wrapper .* VecFrameStack: train without it"),
        (
            lambda: gymnasium.wrappers.NormalizeObservation(sparring.Environment("kessler/survival")),
            "`envs` must have no wrapper .* NormalizeObservation",
        ),
        (
            lambda: gymnasium.wrappers.RescaleAction(sparring.Environment("kessler/survival"), np.float32(-2), np.float32(2)),
            "`envs` must have no wrapper .* RescaleAction",
        ),
        (lambda: rows("docking/single", envs=1), r"shape \(8,\) or \(1, 8\) of `envs`, got \(72,\)"),
        (lambda: rows(envs=1, threads=1, threats=4), r"shape \(44,\) or \(3, 44\) of `envs`, got \(72,\)"),
        (lambda: rows(envs=1, actions="discrete"), "`model` must be trained on the actions of `envs`"),
        (lambda: sparring.make_vec("kessler/survival", 1, observation="telemetry"), "'satellites': .* of `envs`"),
        (lambda: VecNormalize(VecNormalize(rows(envs=1))), "`envs` must have at most one VecNormalize"),
    ],
)
def test_invalid_environments_are_described(envs, message, model, file):
    with pytest.raises(ValueError, match=message):
        sparring.export_onnx(model, file, envs=envs())
    assert not list(file.parent.iterdir())


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"normalize": 3}, "`normalize` must be a VecNormalize of Stable-Baselines3, got 3"),
        ({"normalize": VecNormalize(rows("docking/single", envs=1))}, "`normalize` must be of observations of the shapes"),
        ({"name": 3}, "`name` must be a text, got 3"),
        ({"output": "logits"}, "`output` must be actions, since `envs` have continuous actions, got 'logits'"),
        ({"output": "tanh"}, "`output` must be one of actions, logits, got 'tanh'"),
    ],
)
def test_invalid_argument_is_described(settings, message, model, file):
    with pytest.raises(ValueError, match=message):
        sparring.export_onnx(model, file, **settings)
    assert not list(file.parent.iterdir())


def test_module_needs_environments(file):
    with pytest.raises(ValueError, match="`envs` must be given, since the model has no environment"):
        sparring.export_onnx(linear(), file)


@pytest.mark.parametrize("path", ["missing/policy.onnx", "file/policy.onnx", "folder"])
def test_unwritable_file_is_described(path, model, tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    with pytest.raises(ValueError, match=f"`file` must be a path that can be written, got .*{path}: [A-Z]"):
        sparring.export_onnx(model, tmp_path / path)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["file", "folder"]


def test_recurrent_policy_is_rejected(model, file, monkeypatch):
    monkeypatch.setattr(model.policy, "lstm_actor", linear(), raising=False)
    with pytest.raises(ValueError, match="`model` must be a PPO, A2C, DQN, SAC or TD3 whose policy is not recurrent"):
        sparring.export_onnx(model, file)


def test_package_needs_neither_torch_nor_onnx():
    program = "import sys, sparring; assert not {'torch', 'onnx', 'stable_baselines3'} & sys.modules.keys()"
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.parametrize("missing", ["torch", "onnx"])
def test_missing_package_is_named(missing):
    program = f"import sys; sys.modules[{missing!r}] = None; import sparring; sparring.export_onnx"
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert "ImportError: sparring.export_onnx needs onnx and torch: pip install 'sparring[onnx]'" in ended.stderr


@needs_server
@pytest.mark.parametrize("tasks", [["kessler/eco_station", "kessler/survival"], ["docking/multiagent"]])
def test_tasks_of_a_curriculum_are_recorded(tasks, file):
    with local_curriculum(settings={"tasks": tasks}) as curriculum:
        envs = sparring.sb3.vec_env(2, curriculum=curriculum)
        sparring.export_onnx(make(PPO, envs), file)
        envs.close()
    assert sorted(metadata(file)["tasks"].split(",")) == tasks
