"""Graph of a policy: a module of torch that has the interface of the file, and its ONNX form."""

from __future__ import annotations

import inspect
import io
import warnings
from typing import Any

import numpy as np
import numpy.typing as npt
import onnx
import torch
from torch import nn

from .interface import OBSERVATIONS, ROWS, PolicyInterface
from .source_policy import evaluating

#: Version of ONNX's operators: the newest that the exporter of torch 1.13 has.
OPSET = 17
#: Operators with graphs of their own, which a policy has no need of.
CONTROL_FLOW = ("If", "Loop", "Scan")


class Normalization(nn.Module):
    """Normalisation of observations as by `VecNormalize`: (x − mean)/√(variance + ε), clipped.

    `VecNormalize` computes in double precision. The mean is the sum of two numbers of single precision here, so that small
    differences from the mean stay exact.
    """

    def __init__(self, mean: npt.NDArray[np.float64], variance: npt.NDArray[np.float64], epsilon: float, clip: float) -> None:
        super().__init__()
        rounded = mean.astype(np.float32)
        self.register_buffer("mean", torch.from_numpy(rounded))
        self.register_buffer("mean_rest", torch.from_numpy((mean - rounded).astype(np.float32)))
        self.register_buffer("deviation", torch.from_numpy(np.sqrt(variance + epsilon).astype(np.float32)))
        self.clip = float(clip)

    def forward(self, observations: Any) -> Any:
        """Returns the observations, normalised and clipped."""
        return (((observations - self.mean) - self.mean_rest) / self.deviation).clamp(-self.clip, self.clip)


class PolicyModule(nn.Module):
    """Maps the inputs of a file to its output: normalises, runs the network, and scales and clips actions.

    Args:
        network: Network from observations to actions or logits.
        interface: Interface of the file.
        shapes: Shape of each input as the network takes it.
        normalizations: Normalisation of inputs, by their names.
        is_squashed: True to scale actions from -1 to 1 to the action space.
    """

    def __init__(
        self,
        network: nn.Module,
        interface: PolicyInterface,
        shapes: dict[str, tuple[int, ...]],
        normalizations: dict[str, Normalization],
        is_squashed: bool,
    ) -> None:
        super().__init__()
        self.network = network
        self.interface = interface
        self.shapes = shapes
        self.normalizations = nn.ModuleDict(normalizations).to(device_of(network))
        self.is_squashed = is_squashed

    def forward(self, *inputs: Any) -> Any:
        """Returns actions or logits."""
        parts = {}
        for (name, shape), value in zip(self.interface.inputs.items(), inputs, strict=True):
            if self.shapes[name] != shape:
                value = value.reshape(-1, *self.shapes[name])
            parts[name] = self.normalizations[name](value) if name in self.normalizations else value
        output = self.network(parts if self.interface.is_telemetry else parts[OBSERVATIONS])
        if self.interface.output == "actions":
            low, high = self.interface.action_range
            if self.is_squashed:
                output = low + 0.5 * (output + 1.0) * (high - low)
            output = output.clamp(low, high)
        shape = self.interface.output_shape
        return output if len(shape) == 1 else output.reshape(-1, *shape)


def device_of(module: nn.Module) -> Any:
    """Returns the device of a module's first parameter, the CPU without any."""
    return next((parameter.device for parameter in module.parameters()), torch.device("cpu"))


def run_module(module: PolicyModule, inputs: dict[str, npt.NDArray[np.float32]]) -> npt.NDArray[np.float32]:
    """Runs the module on arrays.

    Raises:
        ValueError: The network rejects the observations, or its output has another size than the actions.
    """
    expected = (len(next(iter(inputs.values()))), *module.interface.output_shape)
    try:
        with evaluating(module), torch.no_grad():
            output = module(*_tensors(module, inputs))
    except Exception as error:
        shapes = ", ".join(f"{name} {[ROWS, *shape]}".replace("'", "") for name, shape in module.interface.inputs.items())
        wanted = f"{module.interface.output} {[ROWS, *module.interface.output_shape]}".replace("'", "")
        reason = str(error).strip().split("\n")[0]
        raise ValueError(f"`model` must map {shapes} to {wanted}, got an error: {reason}") from error
    if not isinstance(output, torch.Tensor) or output.dtype != torch.float32:
        found = getattr(output, "dtype", type(output).__name__)
        raise ValueError(f"`model` must return {module.interface.output} as a tensor of float32, got {found}")
    if tuple(output.shape) != expected:
        raise ValueError(f"`model` must return {module.interface.output} of shape {expected}, got {tuple(output.shape)}")
    array: npt.NDArray[np.float32] = output.cpu().numpy()
    return array


def build_graph(module: PolicyModule, inputs: dict[str, npt.NDArray[np.float32]]) -> onnx.ModelProto:
    """Returns the ONNX form of a module, with the metadata of its interface.

    Raises:
        ValueError: The module has an operator that the graph cannot have.
    """
    buffer = io.BytesIO()
    interface = module.interface
    names = [*interface.inputs, interface.output]
    # Newer versions of torch have a second exporter, which needs more packages and writes newer operators.
    exporter = {"dynamo": False} if "dynamo" in inspect.signature(torch.onnx.export).parameters else {}
    try:
        with evaluating(module), torch.no_grad(), warnings.catch_warnings():
            for category in (DeprecationWarning, FutureWarning):
                warnings.simplefilter("ignore", category)
            torch.onnx.export(
                module,
                _tensors(module, inputs),
                buffer,
                input_names=list(interface.inputs),
                output_names=[interface.output],
                dynamic_axes={name: {0: ROWS} for name in names},
                opset_version=OPSET,
                **exporter,
            )
    except Exception as error:
        reason = str(error).strip().split("\n")[0]
        raise ValueError(f"`model` must consist of operators of ONNX opset {OPSET}, got an error: {reason}") from error
    graph = onnx.load_model_from_string(buffer.getvalue())
    _set_interface(graph, interface)
    _check_graph(graph)
    return graph


def _set_interface(graph: onnx.ModelProto, interface: PolicyInterface) -> None:
    """Names and types inputs and output, and sets the metadata."""
    for field, shapes in (
        (graph.graph.input, interface.inputs),
        (graph.graph.output, {interface.output: interface.output_shape}),
    ):
        infos = [
            onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [ROWS, *shape]) for name, shape in shapes.items()
        ]
        del field[:]
        field.extend(infos)
    graph.graph.name = "policy"
    onnx.helper.set_model_props(graph, interface.metadata)


def _check_graph(graph: onnx.ModelProto) -> None:
    for node in graph.graph.node:
        if node.op_type in CONTROL_FLOW:
            raise ValueError(f"`model` must have no control flow in its forward pass, got the operator {node.op_type}")
        if node.domain not in ("", "ai.onnx"):
            raise ValueError(f"`model` must have operators of ONNX only, got {node.op_type} of the domain {node.domain}")
    onnx.checker.check_model(graph, full_check=True)


def _tensors(module: nn.Module, inputs: dict[str, npt.NDArray[np.float32]]) -> tuple[Any, ...]:
    device = device_of(module)
    return tuple(torch.from_numpy(np.ascontiguousarray(array)).to(device) for array in inputs.values())
