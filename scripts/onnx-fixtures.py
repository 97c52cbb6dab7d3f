"""Writes small ONNX policies, with samples of their outputs, and faulty files: onnx-fixtures.py FOLDER

`<name>.onnx` has random weights of a fixed seed. `<name>.json` has inputs of a few rows, and the outputs that the
policy's own library computes for them: {"inputs": {name: rows}, "output": name, "outputs": rows}. Files in `faulty/` have one
fault each, which their name says; that without metadata has the default settings and never acts, so that readers can accept it.
"""
import json, sys
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize
from torch import nn

import sparring
import sparring.sb3

HIDDEN = 16
#: Rows of a sample.
ROWS = 6
#: Size of the debris array of *telemetry*, which is that of environments with a curriculum.
BODIES = 320


def network(inputs, outputs, scale=1.0):
    """Returns a network of two hidden layers whose outputs change much with its inputs."""
    layers = nn.Sequential(
        nn.Linear(inputs, HIDDEN), nn.Tanh(), nn.Linear(HIDDEN, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, outputs)
    )
    for layer, gain in ((layers[0], 3.0 * scale), (layers[2], 3.0), (layers[4], 2.0)):
        nn.init.orthogonal_(layer.weight, gain)
        nn.init.uniform_(layer.bias, -0.5, 0.5)
    return layers


def rows_of(envs, steps=20):
    """Returns observations of vector environments after some random steps, one row per agent or a dict of parts."""
    envs.reset(seed=5)
    envs.action_space.seed(5)
    observations = None
    for _ in range(steps):
        observations = envs.step(envs.action_space.sample())[0]
    return observations


def plain(array):
    """Returns an array as nested lists, with the fewest digits that single precision needs."""
    return [plain(row) for row in array] if array.ndim else float(str(array))


def write_sample(folder, name, inputs, output, outputs):
    values = {"inputs": {key: plain(part) for key, part in inputs.items()}, "output": output, "outputs": plain(outputs)}
    (folder / f"{name}.json").write_text(json.dumps(values, separators=(",", ":")) + "\n")


def write_rows(folder, name, envs, model, **settings):
    """Writes a torch module with one row per agent."""
    rows = rows_of(envs)
    rows = rows.reshape(-1, rows.shape[-1])[:ROWS]
    sparring.export_onnx(model, folder / f"{name}.onnx", envs=envs, name=name, **settings)
    with torch.no_grad():
        outputs = model(torch.from_numpy(rows))
    if envs.single_action_space.dtype == np.float32:
        write_sample(folder, name, {"observations": rows}, "actions", outputs.clamp(-1.0, 1.0).numpy())
    else:
        write_sample(folder, name, {"observations": rows}, "logits", outputs.numpy())


def reinitialize(policy):
    """Replaces the weights of an actor, since the last layer of Stable-Baselines3 starts near zero."""
    with torch.no_grad():
        for name, weights in sorted(policy.named_parameters()):
            if "policy_net" in name or "action_net" in name:
                nn.init.normal_(weights, 0.0, 1.0 if weights.dim() < 2 else 2.0 / weights.shape[1] ** 0.5)


def ppo(kind, envs, hidden):
    model = PPO(kind, envs, n_steps=2, batch_size=2, seed=7, device="cpu", policy_kwargs={"net_arch": [hidden]})
    reinitialize(model.policy)
    return model


def write_joint(folder, name, task, kind, hidden, rows, **settings):
    """Writes a model of Stable-Baselines3 with one row per environment."""
    model = ppo(kind, sparring.Environment(task, **settings), hidden)
    sparring.export_onnx(model, folder / f"{name}.onnx", name=name)
    envs = sparring.make_vec(task, rows, **settings)
    observations = rows_of(envs)
    inputs = observations if isinstance(observations, dict) else {"observations": observations}
    write_sample(folder, name, inputs, "actions", model.predict(observations, deterministic=True)[0])


def write_normalized(folder, name):
    """Writes a model whose observations are normalised in the graph."""
    envs = VecNormalize(sparring.sb3.vec_env(4, "kessler/survival", level=5))
    envs.seed(5)
    model = ppo("MlpPolicy", envs, HIDDEN)
    envs.reset()
    random = np.random.default_rng(5)
    for _ in range(100):
        envs.step(random.uniform(-1, 1, (envs.num_envs, 2)).astype(np.float32))
    rows = envs.get_original_obs()[:ROWS]
    sparring.export_onnx(model, folder / f"{name}.onnx", name=name)
    write_sample(folder, name, {"observations": rows}, "actions", model.predict(envs.normalize_obs(rows), deterministic=True)[0])


def save_faulty(path, base, nodes, width=72, outputs=2, initializers=(), domains=()):
    """Writes a graph with the metadata of another file."""
    info = helper.make_tensor_value_info
    graph = helper.make_graph(
        nodes,
        "policy",
        [info("observations", TensorProto.FLOAT, ["rows", width])],
        [info("actions", TensorProto.FLOAT, ["rows", outputs])],
        initializer=list(initializers),
    )
    opsets = [helper.make_opsetid("", 17), *(helper.make_opsetid(domain, 1) for domain in domains)]
    model = helper.make_model(graph, opset_imports=opsets, ir_version=8)
    if base is not None:
        helper.set_model_props(model, {entry.key: entry.value for entry in base.metadata_props})
    onnx.save_model(model, path)


def write_faulty(folder, good):
    """Writes files with one fault each, made from a good one."""
    folder.mkdir(exist_ok=True)
    base = onnx.load_model(good)
    zeros = lambda rows, columns: numpy_helper.from_array(np.zeros((rows, columns), np.float32), "weights")
    linear = [helper.make_node("MatMul", ["observations", "weights"], ["actions"])]
    save_faulty(folder / "input_width.onnx", base, linear, width=73, initializers=[zeros(73, 2)])
    save_faulty(folder / "output_width.onnx", base, linear, outputs=3, initializers=[zeros(72, 3)])
    save_faulty(folder / "no_metadata.onnx", None, linear, initializers=[zeros(72, 2)])
    not_finite = [
        helper.make_node("MatMul", ["observations", "weights"], ["zero"]),
        helper.make_node("Div", ["zero", "zero"], ["actions"]),
    ]
    save_faulty(folder / "not_finite.onnx", base, not_finite, initializers=[zeros(72, 2)])
    unknown = [helper.make_node("Steer", ["observations"], ["actions"], domain="example.custom")]
    save_faulty(folder / "unknown_operator.onnx", base, unknown, domains=["example.custom"])
    content = good.read_bytes()
    (folder / "truncated.onnx").write_bytes(content[: len(content) // 2])


def main():
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    torch.manual_seed(7)
    survival = {"task": "kessler/survival", "num_envs": 2, "level": 5, "autoreset_mode": "same_step"}
    write_rows(folder, "tracks_continuous", sparring.make_vec(**survival), network(72, 2))
    write_rows(folder, "tracks_discrete", sparring.make_vec(**survival, actions="discrete"), network(72, 17))
    docking = sparring.make_vec("docking/single", ROWS, autoreset_mode="same_step")
    write_rows(folder, "state_docking", docking, network(8, 3, scale=0.01))
    write_joint(folder, "telemetry_kessler", "kessler/survival", "MultiInputPolicy", 2, 2, observation="telemetry", bodies=BODIES)
    write_joint(folder, "telemetry_docking", "docking/multiagent", "MultiInputPolicy", HIDDEN, ROWS, observation="telemetry")
    write_joint(folder, "joint_tracks", "kessler/survival", "MlpPolicy", HIDDEN, ROWS)
    write_normalized(folder, "normalized")
    write_faulty(folder / "faulty", folder / "tracks_continuous.onnx")
    for file in sorted(folder.rglob("*.onnx")):
        print(f"{file.relative_to(folder)}: {file.stat().st_size} bytes")
        assert file.stat().st_size < 20_000, file


if __name__ == "__main__":
    main()
