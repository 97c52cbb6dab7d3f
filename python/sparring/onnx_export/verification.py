"""Comparison of a file's graph with its model on observations of the environment."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import onnx
import onnx.reference

from ..vector import make_vec
from .environments import PolicyEnvironment
from .interface import PolicyInterface

#: Environments and steps of the sample.
SAMPLE_ENVS, SAMPLE_STEPS = 8, 12
#: Largest accepted difference, as a share of the range of actions or of the largest logit.
TOLERANCE = 1e-4


def sample_observations(environment: PolicyEnvironment) -> Any:
    """Returns observations of new environments with the same settings, under random actions."""
    settings = environment.settings
    names = ("observation", "threats", "look_ahead", "bodies", "actions", "axes")
    arguments = {name: getattr(settings, name) for name in names}
    if settings.curriculum is None:
        arguments |= {name: getattr(settings, name) for name in ("params", "physics", "layout", "level")}
        arguments["bodies"] = environment.layout.bodies if environment.is_telemetry and environment.layout.is_kessler else None
    else:
        counts = [param.name for param in settings.spec.params if param.name in ("deputies", "satellites")]
        arguments["params"] = dict.fromkeys(counts, environment.agents)
    envs = make_vec(settings.spec.id, SAMPLE_ENVS, autoreset_mode="same_step", threads=1, **arguments)
    try:
        observations = [envs.reset(seed=0)[0]]
        envs.action_space.seed(0)
        observations += [envs.step(envs.action_space.sample())[0] for _ in range(SAMPLE_STEPS)]
    finally:
        envs.close()
    if environment.is_telemetry:
        return {name: np.concatenate([parts[name] for parts in observations]) for name in environment.telemetry_shapes()}
    return np.concatenate(observations)


def run_graph(graph: onnx.ModelProto, inputs: dict[str, npt.NDArray[np.float32]]) -> npt.NDArray[np.float32]:
    """Runs a graph by the reference implementation of ONNX."""
    (output,) = onnx.reference.ReferenceEvaluator(graph).run(None, inputs)
    array: npt.NDArray[np.float32] = output
    return array


def compare_outputs(interface: PolicyInterface, graph: npt.NDArray[np.float32], model: npt.NDArray[np.float32]) -> float:
    """Returns the largest difference between the outputs of graph and model.

    Raises:
        ValueError: The difference is above the tolerance, or a value is not finite.
    """
    if not np.isfinite(model).all():
        raise ValueError(f"`model` must return finite {interface.output}, got NaN or infinity on observations of `envs`")
    difference = float(np.abs(graph - model).max()) if graph.shape == model.shape else np.inf
    low, high = interface.action_range
    scale = high - low if interface.output == "actions" else max(1.0, float(np.abs(model).max()))
    if not difference <= TOLERANCE * scale:
        raise ValueError(
            f"`model` must compute the same as its ONNX graph, got a difference of {difference:.3g} in {interface.output}: its"
            " forward pass must be deterministic and have no branch that depends on values"
        )
    return difference


def compare_predictions(interface: PolicyInterface, graph: npt.NDArray[np.float32], predicted: npt.NDArray[Any]) -> None:
    """Compares the outputs of a graph with deterministic actions or choices of the model's own library.

    Raises:
        ValueError: An action or a choice differs.
    """
    if interface.output == "actions":
        compare_outputs(interface, graph, predicted.reshape(graph.shape))
        return
    logits = graph.reshape(-1, graph.shape[-1]).astype(np.float64)
    chosen = np.take_along_axis(logits, predicted.reshape(-1, 1).astype(np.int64), axis=1)[:, 0]
    # Logits that are equal within rounding are ties.
    shortfall = float((logits.max(axis=1) - chosen).max())
    if not shortfall <= TOLERANCE * max(1.0, float(np.abs(logits).max())):
        raise ValueError(f"`model` must choose as its ONNX graph does, got a choice whose logit is {shortfall:.3g} too low")
