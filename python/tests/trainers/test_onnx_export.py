"""ONNX files compute what their models compute, for all algorithms, observations and actions."""

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
pytest.importorskip("tract")
import onnx
import torch
from documents import code_blocks, replace_all
from onnx_policies import (
    FIXTURES,
    OPERATORS,
    TOLERANCE,
    assert_equal_actions,
    assert_plain_graph,
    interface,
    make,
    metadata,
    observe,
    rows,
    run,
    sample,
    strengthen,
)
from stable_baselines3 import A2C, DQN, PPO, SAC, TD3
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecMonitor, VecNormalize
from torch import nn

import sparring
import sparring.sb3
from sparring.experiments import ppo

CONTINUOUS, DISCRETE = [PPO, A2C, SAC, TD3], [PPO, A2C, DQN]


@pytest.fixture
def file(tmp_path):
    return tmp_path / "policy.onnx"


@pytest.fixture
def full_load(monkeypatch):
    """The restricted loader of torch 1.13 rejects numbers of optimisers, so files of these tests are loaded without it."""
    if torch.__version__.startswith("1."):
        load = torch.load
        monkeypatch.setattr(torch, "load", lambda *arguments, weights_only, **settings: load(*arguments, **settings))


@pytest.mark.parametrize(
    ("algorithm", "actions"), [*((kind, "continuous") for kind in CONTINUOUS), *((kind, "discrete") for kind in DISCRETE)]
)
@pytest.mark.parametrize("task", ["kessler/survival", "docking/multiagent"])
def test_rows_of_agents_get_the_actions_of_the_model(algorithm, actions, task, file):
    envs = rows(task, actions=actions)
    model = make(algorithm, envs)
    exported = sparring.export_onnx(model, file, name="a name")
    assert_equal_actions(file, model, observe(model, envs))
    assert_plain_graph(file)
    values, size, choices = (72, 2, 17) if task.startswith("kessler") else (8, 3, 27)
    output = ("actions", size) if actions == "continuous" else ("logits", choices)
    assert interface(file) == {"observations": ["rows", values], output[0]: ["rows", output[1]]}
    expected = {"format": "1", "tasks": task, "actions": actions, "version": sparring.__version__, "name": "a name"}
    kessler = {"world": "kessler@1", "observation": "tracks", "axes": "agent", "threats": "8", "look_ahead": "15"}
    docking = {"world": "docking@1", "observation": "state", "axes": "world"}
    assert metadata(file) == expected | (kessler if task.startswith("kessler") else docking)
    assert exported.file == file
    assert exported.metadata["sparring.name"] == "a name"
    assert exported.rows >= 100
    assert exported.difference <= 2e-5 * max(1.0, float(np.abs(run(file, observe(model, envs, 1))).max()))


@pytest.mark.parametrize("algorithm", [PPO, SAC, TD3])
@pytest.mark.parametrize("task", ["kessler/survival", "docking/single"])
def test_normalisation_is_part_of_the_file(algorithm, task, file):
    envs = VecNormalize(VecMonitor(rows(task)), clip_obs=3.0)
    model = make(algorithm, envs)
    observations = observe(model, envs)
    sparring.export_onnx(model, file)
    assert_plain_graph(file)
    output = assert_equal_actions(file, model, observations, envs)
    plain = model.predict(observations, deterministic=True)[0]
    assert np.abs(output - plain).max() > 0.1, "normalisation matters"


def test_normalisation_of_almost_constant_values_is_exact(file):
    # The deviation of a value that never changes is that of the first update; single precision alone would lose it.
    envs = VecNormalize(rows("docking/single"))
    model = make(PPO, envs)
    envs.obs_rms.mean = np.full(8, 123.456789012)
    envs.obs_rms.var = np.full(8, 1e-8)
    observations = (123.45679 + np.arange(-40, 40)[:, None] * np.full(8, 7.7e-6)).astype(np.float32)
    sparring.export_onnx(model, file)
    expected = model.predict(envs.normalize_obs(observations), deterministic=True)[0]
    assert np.ptp(expected, axis=0).min() > 0.5
    assert np.abs(run(file, observations) - expected).max() <= 2 * TOLERANCE


@pytest.mark.parametrize("actions", ["continuous", "discrete"])
@pytest.mark.parametrize("task", ["kessler/survival", "docking/multiagent"])
@pytest.mark.parametrize("keys", [None, [], "one"])
def test_telemetry_has_a_row_per_environment(task, actions, keys, file):
    def environment():
        return sparring.Environment(task, observation="telemetry", actions=actions, level=2)

    envs = DummyVecEnv([environment, environment])
    parts = {"kessler/survival": ["satellites", "debris", "mask"], "docking/multiagent": ["deputies"]}[task]
    if keys is not None:
        envs = VecNormalize(envs, norm_obs=bool(keys), norm_obs_keys=parts[:1] if keys else None)
    envs.seed(3)
    model = make(PPO, envs, "MultiInputPolicy")
    observations = observe(model, envs, 40)
    sparring.export_onnx(model, file)
    assert_plain_graph(file)
    assert_equal_actions(file, model, observations, envs if keys else None)
    found = interface(file)
    agents = 3
    assert found.pop("actions", None) == (["rows", agents, 2 if "kessler" in task else 3] if actions == "continuous" else None)
    assert found.pop("logits", None) == (["rows", agents, 17 if "kessler" in task else 27] if actions == "discrete" else None)
    assert found == {part: ["rows", *observations[part].shape[1:]] for part in parts}
    bodies = {"bodies": str(observations["mask"].shape[1])} if "mask" in observations else {}
    described = metadata(file)
    assert {key: described[key] for key in bodies} == bodies
    assert ("bodies" in described) == bool(bodies)
    assert (described["observation"], described["axes"]) == ("telemetry", "world")


@pytest.mark.parametrize("algorithm", [PPO, SAC])
def test_single_environment_has_the_rows_of_all_agents(algorithm, file):
    model = make(algorithm, gymnasium.make("sparring/Survival-v0", level=5))
    sparring.export_onnx(model, file)
    assert interface(file) == {"observations": ["rows", 3, 72], "actions": ["rows", 3, 2]}
    assert_plain_graph(file)
    assert_equal_actions(file, model, observe(model, model.get_env()))


@pytest.mark.parametrize("actions", ["continuous", "discrete"])
def test_single_environment_of_one_agent_has_a_row_per_agent(actions, file):
    envs = VecNormalize(DummyVecEnv([lambda: sparring.Environment("docking/single", actions=actions)]))
    model = make(PPO, envs)
    observations = observe(model, envs)
    sparring.export_onnx(model, file)
    output = {"actions": ["rows", 3]} if actions == "continuous" else {"logits": ["rows", 27]}
    assert interface(file) == {"observations": ["rows", 8], **output}
    predicted, _ = model.predict(envs.normalize_obs(observations), deterministic=True)
    computed = run(file, observations.reshape(-1, 8))
    computed = computed if actions == "continuous" else computed.argmax(axis=1)
    assert np.abs(computed - predicted.reshape(computed.shape)).max() <= 2 * TOLERANCE


@pytest.mark.parametrize(
    ("algorithm", "settings"),
    [
        (PPO, {"use_sde": True}),
        (PPO, {"use_sde": True, "policy_kwargs": {"squash_output": True}}),
        (SAC, {"use_sde": True}),
        (PPO, {"policy_kwargs": {"share_features_extractor": False, "activation_fn": nn.ReLU, "net_arch": [32, 16, 8]}}),
        (PPO, {"policy_kwargs": {"net_arch": []}}),
    ],
)
def test_other_policies_of_the_algorithms_are_equal(algorithm, settings, file):
    envs = rows()
    model = make(algorithm, envs, **settings)
    sparring.export_onnx(model, file)
    assert_equal_actions(file, model, observe(model, envs))
    assert_plain_graph(file)


def test_trained_model_is_equal_after_it_was_loaded(file, full_load, tmp_path):
    envs = VecNormalize(rows(envs=4))
    model = PPO("MlpPolicy", envs, n_steps=50, batch_size=300, device="cpu", seed=1, **sparring.sb3.active_only(envs))
    model.learn(1200)
    model.policy.set_training_mode(True)
    sparring.export_onnx(model, file)
    assert all(part.training for part in model.policy.modules()), "the export changes no model"
    model.save(tmp_path / "model.zip")
    envs.save(tmp_path / "normalize.pickle")
    loaded = PPO.load(tmp_path / "model.zip", device="cpu")
    again = tmp_path / "again.onnx"
    with pytest.raises(ValueError, match="`envs` must be given"):
        sparring.export_onnx(loaded, again)
    assert not again.exists()
    normalize = VecNormalize.load(tmp_path / "normalize.pickle", rows(envs=1))
    sparring.export_onnx(loaded, again, envs=normalize)
    assert again.read_bytes() == file.read_bytes()
    sparring.export_onnx(loaded, again, envs=rows(envs=1), normalize=normalize)
    assert again.read_bytes() == file.read_bytes()
    envs.training = False  # the file has the statistics of its export
    observations = observe(model, envs, 20)
    predicted, _ = model.predict(envs.normalize_obs(observations), deterministic=True)
    assert np.abs(run(again, observations) - predicted).max() <= 2 * TOLERANCE


def test_experiment_policy_is_equal(file):
    envs = sparring.make_vec("kessler/rendezvous", 4, threats=5, look_ahead=9, actions="few", level=5)
    policy = ppo.Policy(16 + 7 * 5, 5, ppo.Config(hold_logit=0.0))
    strengthen(policy)
    observations, _ = envs.reset(seed=1)
    sparring.export_onnx(policy, file, envs=envs)
    output = run(file, observations.reshape(-1, 51))
    with torch.no_grad():
        logits = policy.actor(torch.from_numpy(observations)).reshape(-1, 5).numpy()
    assert np.abs(output - logits).max() <= 2 * TOLERANCE * max(1.0, np.abs(logits).max())
    assert (output.argmax(1) == policy.act(observations).reshape(-1)).all()
    described = metadata(file)
    assert (described["threats"], described["look_ahead"], described["actions"]) == ("5", "9", "few")
    assert described["tasks"] == "kessler/rendezvous"


class Attention(nn.Module):
    """Network whose satellites attend to the threats."""

    def __init__(self, size):
        super().__init__()
        self.own, self.threats, self.actor = nn.Linear(16, 12), nn.Linear(7, 12), nn.Linear(24, size)
        self.attention, self.norm = nn.MultiheadAttention(12, 2, batch_first=True), nn.LayerNorm(24)

    def forward(self, rows):
        own, threats = torch.relu(self.own(rows[:, :16])), self.threats(rows[:, 16:].reshape(-1, 8, 7))
        seen, _ = self.attention(own.unsqueeze(1), threats, threats, need_weights=False)
        return self.actor(self.norm(torch.cat([own, seen[:, 0]], dim=1)))


@pytest.mark.parametrize("kind", ["dense", "attention"])
@pytest.mark.parametrize("actions", ["continuous", "discrete"])
def test_modules_of_torch_are_equal(actions, kind, file):
    envs = sparring.make_vec("kessler/survival", 4, actions=actions, level=5)
    size = 2 if actions == "continuous" else 17
    dense = nn.Sequential(nn.Linear(72, 32), nn.GELU(), nn.Dropout(0.5), nn.Linear(32, size))
    module = dense if kind == "dense" else Attention(size)
    strengthen(module)
    name = "actions" if actions == "continuous" else "logits"
    sparring.export_onnx(module, file, envs=envs, output=name)
    observations = envs.reset(seed=2)[0].reshape(-1, 72)
    with torch.no_grad():
        expected = module.eval()(torch.from_numpy(observations)).numpy()
    expected = expected.clip(-1, 1) if actions == "continuous" else expected
    assert np.abs(run(file, observations) - expected).max() <= 2 * TOLERANCE * max(1, np.abs(expected).max())


class Pooling(nn.Module):
    """Network for telemetry of any number of bodies, with visible debris pooled."""

    def __init__(self):
        super().__init__()
        self.debris, self.actor = nn.Linear(4, 8), nn.Linear(8 + 18, 6)

    def forward(self, parts):
        debris = torch.tanh(self.debris(parts["debris"].transpose(1, 2))) * parts["mask"].unsqueeze(2)
        return self.actor(torch.cat([debris.sum(dim=1), parts["satellites"].flatten(1)], dim=1))


def test_module_for_telemetry_is_equal(file):
    envs = sparring.make_vec("kessler/survival", 4, observation="telemetry", bodies=50, level=5)
    module = Pooling()
    sparring.export_onnx(module, file, envs=envs)
    assert interface(file)["debris"] == ["rows", 4, 50]
    assert_plain_graph(file, OPERATORS | {"ReduceSum", "Unsqueeze"})
    observations, _ = envs.reset(seed=2)
    with torch.no_grad():
        expected = module({part: torch.from_numpy(values) for part, values in observations.items()}).clamp(-1, 1).numpy()
    assert np.abs(run(file, observations) - expected.reshape(4, 3, 2)).max() <= 2 * TOLERANCE


def test_environments_are_found_inside_wrappers(file):
    model = make(PPO, rows())

    def environment():
        return gymnasium.wrappers.RecordEpisodeStatistics(sparring.Environment("kessler/formation", threats=8))

    wrapped = [
        VecMonitor(rows("kessler/formation")),
        gymnasium.make("sparring/Formation-v0"),
        gymnasium.make_vec("sparring/Formation-v0", num_envs=2),
        gymnasium.make_vec("sparring/Formation-v0", num_envs=2, vectorization_mode="sync"),
        DummyVecEnv([environment]),
        SubprocVecEnv([environment]),
    ]
    for envs in wrapped:
        sparring.export_onnx(model, file, envs=envs)
        assert metadata(file)["tasks"] == "kessler/formation"
        envs.close()


def test_printed_code_exports(full_load, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shorter = {"model.learn(10_000)": "model.learn(2_000)"}
    exec(replace_all("\n".join(code_blocks("docs/guides/export-onnx.md")), shorter), {})
    assert capsys.readouterr().out.startswith("policy.onnx tracks ")
    assert metadata("policy.onnx")["observation"] == "tracks"


def test_fixtures_compute_their_samples():
    names = sorted(path.stem for path in FIXTURES.glob("*.onnx"))
    assert len(names) >= 7
    for name in names:
        inputs, output, expected = sample(name)
        file = FIXTURES / f"{name}.onnx"
        assert interface(file).keys() == {*inputs, output}
        computed = run(file, inputs)
        assert computed.shape == expected.shape
        assert np.abs(computed - expected).max() <= 2 * TOLERANCE * max(1, np.abs(expected).max()), name
        assert np.ptp(expected) > 0.1
        assert metadata(file)["format"] == "1"
        assert_plain_graph(file)
        assert file.stat().st_size < 20_000
    for file in FIXTURES.glob("faulty/*.onnx"):
        if file.stem == "truncated":
            with pytest.raises(Exception, match="pars"):
                onnx.load_model(file)
        else:
            onnx.load_model(file)
