"""Interface of a policy in an ONNX file: inputs, output and metadata."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, get_args

from .._native import __version__
from ..errors import invalid, one_of
from .environments import PolicyEnvironment

Output = Literal["actions", "logits"]

#: Version of the format of the file.
FORMAT = "1"
#: Name of the only input, except with *telemetry*.
OBSERVATIONS = "observations"
#: Name of the first axis of inputs and outputs.
ROWS = "rows"


@dataclass(frozen=True)
class ActionShape:
    """Shape of the actions of one row."""

    #: Shape of an action: values, agents × values, and with choices none or the agents.
    shape: tuple[int, ...]
    #: Number of choices of a discrete action; None for continuous actions.
    choices: int | None

    def output_shape(self) -> tuple[int, ...]:
        """Returns the shape of actions or logits."""
        return self.shape if self.choices is None else (*self.shape, self.choices)


@dataclass(frozen=True)
class PolicyInterface:
    """Inputs, output and metadata of a file. Shapes leave out the first axis, the rows."""

    #: Shape of each input.
    inputs: dict[str, tuple[int, ...]]
    #: Name of the output: `actions` are in the units of the environment, and the largest of `logits` is chosen.
    output: Output
    #: Shape of the output.
    output_shape: tuple[int, ...]
    #: Minimum and maximum of continuous actions.
    action_range: tuple[float, float]
    #: Properties of the file.
    metadata: dict[str, str]

    @property
    def is_telemetry(self) -> bool:
        """True if each part of an observation is an input."""
        return list(self.inputs) != [OBSERVATIONS]


def agent_interface(environment: PolicyEnvironment, name: str | None) -> PolicyInterface:
    """Returns the interface of a policy with one row per agent, or per environment with *telemetry*."""
    low, high, _ = environment.settings.spec.action_range
    action = expected_action(environment, is_joint=environment.is_telemetry)
    return PolicyInterface(
        inputs=environment.telemetry_shapes() if environment.is_telemetry else {OBSERVATIONS: (environment.values,)},
        output="actions" if action.choices is None else "logits",
        output_shape=action.output_shape(),
        action_range=(low, high),
        metadata=_metadata(environment, name),
    )


def joint_interface(environment: PolicyEnvironment, name: str | None) -> PolicyInterface:
    """Returns the interface of a policy that maps the observations of all agents to the actions of all agents."""
    interface = agent_interface(environment, name)
    if environment.is_telemetry or environment.agents == 1:
        return interface
    shapes: dict[str, tuple[int, ...]] = {OBSERVATIONS: (environment.agents, environment.values)}
    return replace(interface, inputs=shapes, output_shape=(environment.agents, *interface.output_shape))


def expected_action(environment: PolicyEnvironment, *, is_joint: bool) -> ActionShape:
    """Returns the action of an agent, or of all agents if `is_joint`."""
    settings = environment.settings
    agents = (environment.agents,) if is_joint else ()
    if settings.is_discrete:
        return ActionShape(agents, len(settings.choices))
    return ActionShape((*agents, environment.layout.action_size), None)


def check_output(output: str | None, interface: PolicyInterface) -> None:
    """Checks the argument `output` against the actions of the environment.

    Raises:
        ValueError: The output is unknown, or does not belong to the environment's actions.
    """
    if output not in (None, *get_args(Output)):
        raise one_of("output", get_args(Output), output)
    if output not in (None, interface.output):
        kind = "continuous" if interface.output == "actions" else "discrete"
        raise invalid("output", f"{interface.output}, since `envs` have {kind} actions", output)


def _metadata(environment: PolicyEnvironment, name: str | None) -> dict[str, str]:
    settings, layout = environment.settings, environment.layout
    metadata = {
        "format": FORMAT,
        "world": settings.spec.world,
        "tasks": ",".join(environment.tasks()),
        "observation": layout.mode,
        "actions": ("few" if settings.actions == "few" else "discrete") if settings.is_discrete else "continuous",
        "axes": settings.action_axes(),
        "version": __version__,
    }
    if layout.mode == "tracks":
        metadata |= {"threats": str(environment.threats), "look_ahead": str(environment.look_ahead)}
    if layout.mode == "telemetry" and layout.is_kessler:
        metadata["bodies"] = str(layout.bodies)
    if name is not None:
        metadata["name"] = name
    return {f"sparring.{key}": value for key, value in metadata.items()}
