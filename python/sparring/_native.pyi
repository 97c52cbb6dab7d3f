"""
What `sparring` is built on. Import `sparring` instead.
"""

from _typeshed import Incomplete, SupportsGetItem
import numpy
import numpy.typing
from typing import Any, Final, SupportsFloat, SupportsIndex, final

__version__: Final[str]
"""
The version of the wheel.
"""

@final
class NativeBatch:
    """
    A batch of environments of one task.
    """
    def __new__(cls, /, recipe: str, envs: SupportsIndex, *, observe: str, bodies: SupportsIndex | None, threats: SupportsIndex, look_ahead: SupportsIndex, axes: str, discrete: bool, autoreset_mode: str, threads: SupportsIndex | None, seed: SupportsIndex, single: bool, curriculum: NativeCurriculum | None = None) -> NativeBatch:
        """
        `recipe` is a scenario without its seed, as JSON. `observe` is "all" or "tracks"; `axes` "world" or "agent". With
        `discrete` actions are numbers of the task's choices. `single` drops the first axis of all arrays but flags.
        """
    def abandon(self, /) -> None:
        """
        Gives up for good what is being flown: the curriculum has nobody else fly it to its end.
        """
    def absent(self, /) -> "numpy.typing.NDArray[numpy.bool_]":
        """
        Who takes no part in what is flown now.
        """
    def agents(self, /) -> "tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.bool_]]":
        """
        Of the last step: what each agent earned, who has left and whom the horizon cut off.
        """
    def alerts(self, /, env: SupportsIndex) -> list[str]:
        """
        What happened in the last step of an environment, in words.
        """
    def columns(self, /) -> list[str]:
        """
        What the values of an observation are called.
        """
    def episode(self, /, env: SupportsIndex) -> tuple[NativeScenario, float] | None:
        """
        The scenario an environment flies, and its score so far; none before the first reset.
        """
    def episodes(self, /) -> "tuple[numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float64]]":
        """
        Of the last step: whose episode ended, and its return, its length and how many seconds it took; zeros for the others.
        """
    def final_observations(self, /) -> "numpy.typing.NDArray[numpy.float32]":
        """
        Of the last step, where the same step resets: the last observations of the environments whose episode ended, in order.
        """
    def leave(self, /) -> None:
        """
        Gives back to the curriculum what is being flown.
        """
    def lessons(self, /) -> "tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.bool_]]":
        """
        Of each environment: the level of what it flies (-1: none), whether to learn from it, and whether it rests, since a
        curriculum has nothing left for it.
        """
    @property
    def recipe(self, /) -> str:
        """
        The scenario without its seed that was asked for, complete, as JSON.
        """
    def render(self, /, env: SupportsIndex, width: SupportsIndex, height: SupportsIndex) -> "numpy.typing.NDArray[numpy.uint8]":
        """
        A picture of an environment, height × width × 3.
        """
    def reset(self, /, seeds: SupportsGetItem[int, Any | None] | None = None, mask: Any | None = None, out: Any | None = None, recipes: SupportsGetItem[int, NativeScenario | None] | None = None, scenarios: SupportsGetItem[int, NativeScenario | None] | None = None) -> "numpy.typing.NDArray[numpy.float32]":
        """
        Begins the next episode of every environment, or of those in `mask`; `seeds` has a seed or none for each, `recipes` what it
        flies from here on, by seeds of its own, and `scenarios` what it flies first. All observations. What is refused moves nothing.
        """
    @property
    def sizes(self, /) -> tuple[int, int, int]:
        """
        Agents, values of an action, values of an observation.
        """
    def state_hash(self, /, env: SupportsIndex) -> bytes | None:
        """
        A digest of every bit of an environment's state.
        """
    def step(self, /, actions: Any, out: tuple[Any, Any, Any, Any] | None = None) -> "tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.bool_], bool]":
        """
        One step of every environment, into `out` (observations, rewards, terminations, truncations) where it is given.
        """
    def taken(self, /) -> "numpy.typing.NDArray[numpy.float32]":
        """
        What each agent did in the last step, along the world's axes.
        """
    def telemetry(self, /, env: SupportsIndex) -> str | None:
        """
        What the agents of an environment see, in the wire form, as JSON.
        """
    @property
    def threads(self, /) -> int:
        """
        Threads that step it.
        """

@final
class NativeCurriculum:
    """
    A run's curriculum, as a trainer takes part in it.
    """
    def __new__(cls, /, url: str, run: str, token: str | None, *, columns: bool, groups: SupportsIndex, otherwise: SupportsIndex | None, group_size: SupportsIndex | None, purpose: str, evaluation: str | None, ttl_s: SupportsIndex, ahead: SupportsIndex, buffer: SupportsIndex, patience_s: SupportsFloat | SupportsIndex) -> NativeCurriculum:
        """
        Begins to take leases of a run.
        """
    def close(self, /, timeout_s: SupportsFloat | SupportsIndex) -> None:
        """
        Hands in all there is, gives back what was not flown, and ends. What could not be handed in in time is an error. Who is
        interrupted may close once more.
        """
    def flush(self, /, timeout_s: SupportsFloat | SupportsIndex) -> None:
        """
        Waits until what was flown of whole leases is handed in.
        """
    def gone(self, /, how: str) -> None:
        """
        The server was this process's own and has ended, in words: nobody waits for it any more, unless it answers all the same.
        """
    @property
    def policy_version(self, /) -> int:
        """
        Which policy flies what is flown from now on.
        """
    @policy_version.setter
    def policy_version(self, /, version: SupportsIndex) -> None: ...
    def stats(self, /) -> str:
        """
        What became of everything, as JSON.
        """

@final
class NativeLink:
    """
    The way to a server, for what is asked now and then.
    """
    def __new__(cls, /, url: str, token: str | None = None) -> NativeLink: ...
    def ask(self, /, method: str, path: str, body: str | None = None, *, patience_s: SupportsFloat | SupportsIndex = 30.0, wait: bool = False) -> str:
        """
        Asks, again while the server is busy but not for longer than `patience_s`, nor where it may have done what is not to be
        done twice; JSON comes back. With `wait` one that does not answer may come back, too, and is only looked at by then.
        """

@final
class NativePolicy:
    """
    A built-in policy that flies a scenario.
    """
    def __new__(cls, /, name: str, scenario: NativeScenario, seed: SupportsIndex) -> NativePolicy: ...
    def act(self, /, telemetry: str) -> "numpy.typing.NDArray[numpy.float64]":
        """
        What each agent does, along the world's axes, on what it sees (the wire form, as JSON).
        """

@final
class NativeScenario:
    """
    A scenario: `(scenario, actions)` decides every bit of an episode.
    """
    def __eq__(self, value: object, /) -> bool: ...
    def __hash__(self, /) -> int: ...
    def __ne__(self, value: object, /) -> bool: ...
    def __new__(cls, /, text: str, any_seed: bool = False) -> NativeScenario:
        """
        Reads the wire form. With `any_seed` training and evaluation seeds are read too: to look at, not to fly in an environment.
        """
    @property
    def agents(self, /) -> int:
        """
        Agents at the start.
        """
    @property
    def horizon(self, /) -> int:
        """
        Steps after which an episode is truncated.
        """
    @property
    def id(self, /) -> str:
        """
        Its id: the blake3 of its canonical form.
        """
    @property
    def seed(self, /) -> int:
        """
        Its seed.
        """
    @property
    def task(self, /) -> str:
        """
        The task's id.
        """
    def to_json(self, /) -> str:
        """
        The wire form, complete.
        """

def bracket(scenario: NativeScenario) -> "tuple[str, numpy.typing.NDArray[numpy.float64]]":
    """
    What a scenario is worth, as JSON, and the reference's actions.
    """

def card(task: str) -> str:
    """
    A task as data, as JSON: params, options, levels, actions, policies.
    """

def critique(scenario: NativeScenario, actions: Any, stopped: str | None = None) -> str:
    """
    What an episode shows, as JSON.
    """

def fly(scenario: NativeScenario, policy: str, seed: SupportsIndex) -> "tuple[str, numpy.typing.NDArray[numpy.float64]]":
    """
    Flies a scenario by a built-in policy to its end: how it went, as JSON, and what was done.
    """

def is_local(url: str) -> bool:
    """
    Whether an address is of this machine itself.
    """

def replay(scenario: NativeScenario, actions: Any, stopped: str | None = None) -> str:
    """
    What these actions earn on a scenario, as JSON.
    """

def tasks() -> list[str]:
    """
    The ids of all tasks.
    """

def __getattr__(name: str) -> Incomplete: ...
