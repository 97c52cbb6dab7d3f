"""Models, observations and graphs for the tests of ONNX exports."""

import json
import pathlib

import numpy as np
import onnx.reference
import torch
import tract
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

import sparring
import sparring.sb3

FIXTURES = pathlib.Path(__file__).parents[3] / "tests/fixtures/onnx"
#: Largest difference of an action, as a share of the action range, or of a logit, as a share of the largest.
TOLERANCE = 1e-5
#: Operators that the graphs of these tests may have: those of networks of dense layers.
OPERATORS = {
    *("Add", "Cast", "Clip", "Concat", "Constant", "Div", "Flatten", "Gemm"),
    *("Identity", "MatMul", "Mul", "Relu", "Reshape", "Sub", "Tanh", "Transpose"),
}


def rows(task="kessler/survival", envs=6, **settings):
    """Returns seeded environments with a row per agent; in kessler, hold loses satellites early."""
    if task.startswith("kessler"):
        settings = {"level": 5, **settings}
    made = sparring.sb3.vec_env(envs, task, **settings)
    made.seed(4)
    return made


def make(algorithm, envs, policy="MlpPolicy", seed=1, **settings):
    """Returns a model whose untrained actor acts strongly: the last layers of new actors are near zero."""
    memory = {"buffer_size": 100} if issubclass(algorithm, OffPolicyAlgorithm) else {}
    model = algorithm(policy, envs, device="cpu", seed=seed, **{**memory, **settings})
    strengthen(model.policy)
    return model


def strengthen(network):
    """Multiplies weights, and sets biases, so that outputs differ from row to row."""
    generator = torch.Generator().manual_seed(3)
    with torch.no_grad():
        for weights in network.parameters():
            if weights.dim() == 2:
                deviation = 1.5 / weights.shape[1] ** 0.5
                weights.copy_(torch.randn(weights.shape, generator=generator) * deviation)


def observe(model, envs, steps=60):
    """Returns observations of vector environments, before normalisation, while the model acts."""
    observations = envs.reset()
    collected = []
    for _ in range(steps):
        collected.append(envs.get_original_obs() if isinstance(envs, VecNormalize) else observations)
        observations, *_ = envs.step(model.predict(observations, deterministic=True)[0])
    if isinstance(collected[0], dict):
        return {part: np.concatenate([step[part] for step in collected]) for part in collected[0]}
    return np.concatenate(collected)


def run(file, inputs):
    """Runs a file on observations, by ONNX's reference implementation and by the library of the program, which must agree."""
    inputs = inputs if isinstance(inputs, dict) else {"observations": inputs}
    (output,) = onnx.reference.ReferenceEvaluator(onnx.load_model(file)).run(None, inputs)
    model = tract.onnx().load(str(file))
    names = [model.input_name(number) for number in range(model.input_count())]
    assert sorted(names) == sorted(inputs)
    (computed,) = model.into_model().into_runnable().run([inputs[name] for name in names])
    assert np.abs(computed.to_numpy() - output).max() <= TOLERANCE * max(2.0, float(np.abs(output).max()))
    return output


def assert_equal_actions(file, model, observations, normalize=None):
    """Compares a file with the predictions of its model; returns the output of the file."""
    output = run(file, observations)
    predicted, _ = model.predict(normalize.normalize_obs(observations) if normalize else observations, deterministic=True)
    if output_name(file) == "logits":
        assert (output.argmax(axis=-1) == predicted).all()
        assert len(np.unique(predicted)) > 3, "the choices differ from row to row"
    else:
        space = model.action_space
        predicted = predicted.reshape(output.shape)
        assert np.abs(output - predicted).max() <= TOLERANCE * float((space.high - space.low).max())
        assert np.ptp(output.reshape(-1, output.shape[-1]), axis=0).min() > 0.1, "the actions differ from row to row"
    return output


def output_name(file):
    """Returns the name of the only output of a file."""
    (output,) = onnx.load_model(file).graph.output
    return output.name


def interface(file):
    """Returns the shapes of the inputs and the output of a file, by name; the name of the rows is `rows`."""
    graph = onnx.load_model(file).graph
    return {
        info.name: [axis.dim_param or axis.dim_value for axis in info.type.tensor_type.shape.dim]
        for info in [*graph.input, *graph.output]
    }


def metadata(file):
    """Returns the properties of a file without their prefix."""
    entries = {entry.key: entry.value for entry in onnx.load_model(file).metadata_props}
    assert all(key.startswith("sparring.") for key in entries)
    return {key.removeprefix("sparring."): value for key, value in entries.items()}


def assert_plain_graph(file, operators=OPERATORS):
    """Checks that a file is standard ONNX in single precision, without data in other files."""
    model = onnx.load_model(file)
    onnx.checker.check_model(model, full_check=True)
    assert [(opset.domain, opset.version <= 17) for opset in model.opset_import] == [("", True)]
    assert {node.op_type for node in model.graph.node} <= operators
    kinds = {onnx.TensorProto.FLOAT, onnx.TensorProto.INT64}
    assert {tensor.data_type for tensor in model.graph.initializer} <= kinds
    assert not any(tensor.external_data for tensor in model.graph.initializer)
    assert not any(part in tensor.name for tensor in model.graph.initializer for part in ("value", "critic", "log_std", "target"))


def sample(name):
    """Returns inputs and expected outputs of a fixture."""
    values = json.loads((FIXTURES / f"{name}.json").read_text())
    inputs = {key: np.array(part, np.float32) for key, part in values["inputs"].items()}
    return inputs, values["output"], np.array(values["outputs"], np.float32)
