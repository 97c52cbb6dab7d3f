"""`sparring.export_onnx`: writes a policy to an ONNX file and verifies the file."""

from __future__ import annotations

import contextlib
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import onnx

from ..errors import invalid
from .environments import PolicyEnvironment, find_environment
from .graph import Normalization, PolicyModule, build_graph, run_module
from .interface import OBSERVATIONS, Output, PolicyInterface, agent_interface, check_output, expected_action, joint_interface
from .source_policy import SourcePolicy
from .sources import check_normalization, find_normalization, moments, read_model
from .verification import compare_outputs, compare_predictions, run_graph, sample_observations


@dataclass(frozen=True)
class ExportedPolicy:
    """ONNX file of a policy, which was compared with its model."""

    #: Path of the file.
    file: Path
    #: Properties of the file.
    metadata: dict[str, str]
    #: Number of rows of observations on which file and model were compared.
    rows: int
    #: Largest difference of an action or a logit on these rows.
    difference: float


def export_onnx(
    model: Any,
    file: str | os.PathLike[str],
    *,
    envs: Any = None,
    normalize: Any = None,
    name: str | None = None,
    output: Output | None = None,
) -> ExportedPolicy:
    """Writes the deterministic policy of a model to an ONNX file.

    `sparring eval --policy onnx:FILE` evaluates the file without Python. The function first compares the file with the model on
    observations of new environments, and writes nothing if they differ.

    Args:
        model: PPO, A2C, DQN, SAC or TD3 of Stable-Baselines3, a `sparring.experiments.ppo.Policy`, or a torch module. A module
            maps rows of observations (with *telemetry*, a dict) to actions in the units of the environment, or to a logit for
            each choice.
        file: Path of the file; an existing file is replaced.
        envs: Environments of the training, or others with equal observations and actions, with or without wrappers (default:
            those of the model).
        normalize: `VecNormalize` of the training (default: that of the model's environments, or of `envs`). Its statistics
            become part of the file.
        name: Free text that describes the policy.
        output: `actions` or `logits` of a torch module (default: as the environments' actions are continuous or discrete).

    Raises:
        ImportError: torch or onnx is missing.
        ValueError: The model, an environment or another argument cannot be exported, the file cannot be written, or the graph
            differs from the model; the message names the argument.
    """
    if name is not None and not isinstance(name, str):
        raise invalid("name", "a text", name)
    source = read_model(model)
    if envs is None and source.envs is None:
        raise ValueError("`envs` must be given, since the model has no environment: pass environments like those of its training")
    environment = find_environment(source.envs if envs is None else envs)
    if normalize is None:
        normalize = find_normalization(source.envs) or find_normalization(envs)
    else:
        check_normalization(normalize)
    interface, shapes = _match_model(source, environment, name)
    check_output(output, interface)
    module = PolicyModule(source.network, interface, shapes, _normalizations(normalize, shapes), source.is_squashed)
    inputs = _rows(sample_observations(environment), interface)
    expected = run_module(module, inputs)
    graph = build_graph(module, {part: array[:3] for part, array in inputs.items()})
    outputs = run_graph(graph, inputs)
    difference = compare_outputs(interface, outputs, expected)
    if source.predict is not None:
        compare_predictions(interface, outputs, source.predict(_model_observations(inputs, shapes, normalize)))
    path = _write(graph, file)
    return ExportedPolicy(path, dict(interface.metadata), len(expected), difference)


def _match_model(
    source: SourcePolicy, environment: PolicyEnvironment, name: str | None
) -> tuple[PolicyInterface, dict[str, tuple[int, ...]]]:
    """Returns the interface of a model, and the shape of each input as its network takes it.

    Raises:
        ValueError: The model has other observations or actions than the environment.
    """
    interface = agent_interface(environment, name)
    is_joint = environment.is_telemetry
    shapes = dict(interface.inputs)
    if source.observation_shape is not None:
        joint_shape = (environment.agents, environment.values)
        expected: Any = interface.inputs if environment.is_telemetry else interface.inputs[OBSERVATIONS]
        if not environment.is_telemetry and source.observation_shape == joint_shape:
            is_joint, interface, shapes = True, joint_interface(environment, name), {OBSERVATIONS: joint_shape}
        elif source.observation_shape != expected:
            either = expected if environment.is_telemetry else f"{expected} or {joint_shape}"
            raise invalid("model", f"trained on observations of the shape {either} of `envs`", source.observation_shape)
    action = expected_action(environment, is_joint=is_joint)
    if source.action not in (None, action):
        raise invalid("model", f"trained on the actions of `envs`, {action}", source.action)
    return interface, shapes


def _normalizations(normalize: Any, shapes: dict[str, tuple[int, ...]]) -> dict[str, Normalization]:
    """Returns the normalisation of each input.

    Raises:
        ValueError: The statistics are of other observations.
    """
    normalizations = {}
    for key, (mean, variance) in ({} if normalize is None else moments(normalize)).items():
        part = key or OBSERVATIONS
        if shapes.get(part) != mean.shape:
            raise invalid("normalize", f"of observations of the shapes {shapes}", f"{part} {mean.shape}")
        normalizations[part] = Normalization(mean, variance, float(normalize.epsilon), float(normalize.clip_obs))
    return normalizations


def _rows(observations: Any, interface: PolicyInterface) -> dict[str, npt.NDArray[np.float32]]:
    """Returns observations of environments as the inputs of a file."""
    parts = observations if interface.is_telemetry else {OBSERVATIONS: observations}
    return {part: np.ascontiguousarray(parts[part].reshape(-1, *shape)) for part, shape in interface.inputs.items()}


def _model_observations(inputs: dict[str, npt.NDArray[np.float32]], shapes: dict[str, tuple[int, ...]], normalize: Any) -> Any:
    """Returns the inputs of a file as the observations of a model in its own library, normalised."""
    parts = {part: array.reshape(-1, *shapes[part]) for part, array in inputs.items()}
    observations: Any = parts.get(OBSERVATIONS, parts)
    return observations if normalize is None else normalize.normalize_obs(observations)


def _write(graph: onnx.ModelProto, file: str | os.PathLike[str]) -> Path:
    """Writes the file in one step, so that no reader sees a part of it."""
    path = Path(file)
    part = path.parent / f".{path.name}.{os.getpid()}.part"
    try:
        part.write_bytes(graph.SerializeToString())
        part.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            part.unlink()
        raise ValueError(f"`file` must be a path that can be written, got {os.fspath(file)}: {error.strerror}") from error
    return path
