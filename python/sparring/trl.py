"""TRL: `Environments` is an `environment_factory` whose groups fly what the curriculum proposes; `CurriculumCallback` counts the
policy's version up and brings the curriculum's numbers to TensorBoard.

curriculum = sparring.Curriculum("http://127.0.0.1:8700", settings={"tasks": ["kessler/survival"], "group_size": 8})
envs = sparring.trl.Environments(curriculum, siblings=8)
trainer = GRPOTrainer(
    model="Qwen/Qwen3-4B",
    args=GRPOConfig(num_generations=8, per_device_train_batch_size=8, report_to="tensorboard"),
    train_dataset=envs.dataset(1000),
    environment_factory=envs,
    callbacks=[sparring.trl.CurriculumCallback(envs)],
)
trainer.train()
envs.close()
"""

from __future__ import annotations

import logging
import math
import os
import threading
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded

try:
    from datasets import Dataset
    from transformers import TrainerCallback
except ImportError as error:
    raise ImportError("sparring.trl needs TRL: pip install 'sparring[trl]'") from error

from .curriculum import Curriculum, CurriculumError
from .scenario import Scenario, bracket
from .single import Environment
from .words import words as words

logger = logging.getLogger(__name__)

Reward = Literal["score", "skill"]

#: What a model is asked, before it is told what it sees.
PROMPT = (
    "You fly three satellites around the Earth, which is at (0, 0); distances are in LU, a step is one TU. Debris that comes "
    "nearer than 2 LU destroys a satellite. Call fire_thrusters where something will pass too near: a change of velocity of 0.1 "
    "some steps before is enough, and costs fuel. Call hold where nothing will. What you leave unflown is flown by holding."
)
#: Pieces of debris that are told of each satellite when a model asks.
FAR = 8

#: An environment whose episode has begun, and whether to learn from it.
Seat = tuple[Environment, bool]


class Environments:
    """Makes environments for `GRPOTrainer(environment_factory=…)`: siblings of a group fly one scenario of the curriculum's.

    Whoever is reset first of a group takes a group of the run, and those who are reset with the same `group_id` after it, up to
    `siblings`, fly the same scenario. The environments fly in this process; each episode is handed in with its actions as it
    ends, and the server works out what it earned. Leases are taken ahead, renewed, and given back by `close`.

    Args:
        curriculum: Whose run is flown. It has to be over tasks of kessler.
        siblings: `num_generations` of the trainer.
        reward: What `get_reward` tells: the `score` of the episode, or its `skill`, which is 0 for acting blindly and 1 for a
            planner with hindsight, and 0 on scenarios on which nothing can be gained. Within a group they say the same.
        near: Pieces of debris that are told of each satellite after an action: what is told counts for
            `max_completion_length`, some 35 tokens each.
        lease: Groups of a lease. Fewer follow the curriculum more closely.
        ttl_s: Seconds that a lease holds; it is renewed at half of them.
        patience_s: How long a reset waits for something to fly while the server is away.

    Raises:
        ValueError: A run over another world, or no siblings.
        CurriculumError: The server refuses.
    """

    def __init__(
        self,
        curriculum: Curriculum,
        siblings: int,
        *,
        reward: Reward = "score",
        near: int = 2,
        lease: int = 1,
        ttl_s: int = 600,
        patience_s: float = 600.0,
    ) -> None:
        others = [task for task in curriculum.tasks if not task.startswith("kessler/")]
        if others:
            raise ValueError(f"curriculum: its run is over {', '.join(others)}; the tools are those of kessler")
        if reward not in ("score", "skill"):
            raise ValueError(f"reward: {reward!r} is neither score nor skill")
        if siblings < 1:
            raise ValueError(f"siblings: {siblings} of them are no group")
        self.curriculum = curriculum
        self.siblings = siblings
        self.reward = reward
        self.near = near
        # Groups come whole only where nobody else takes episodes in between.
        wish = {"group_size": siblings, "lease": lease, "ttl_s": ttl_s, "patience_s": patience_s}
        self._feed = curriculum.beside(form="groups", **wish)
        self._lock = threading.Lock()
        self._begun: dict[str, list[Seat]] = {}
        self._idle: list[Environment] = []

    def __call__(self) -> Pilot:
        """One environment, as TRL asks for them."""
        return Pilot(self)

    def dataset(self, groups: int, prompt: str = PROMPT) -> Dataset:
        """Prompts, one for each group, with the `group_id` that its siblings are reset with.

        Args:
            groups: How many. What is flown is decided when it is flown: going through them again flies other scenarios.
            prompt: What the model is asked; what it sees at the beginning is told after it.
        """
        row = [{"role": "user", "content": prompt + "\n\n"}]
        return Dataset.from_list([{"prompt": row, "group_id": f"group-{number}"} for number in range(groups)])

    @property
    def policy_version(self) -> int:
        """Which policy flies from now on; `CurriculumCallback` sets it."""
        return self._feed.policy_version

    @policy_version.setter
    def policy_version(self, version: int) -> None:
        self._feed.policy_version = version
        self.curriculum.policy_version = version

    def numbers(self) -> dict[str, float]:
        """`Curriculum.numbers` of the run, with what was flown here.

        Raises:
            CurriculumError: The server is away.
        """
        return self._feed.numbers()

    def stats(self) -> dict[str, Any]:
        """`Curriculum.stats` of what was flown here."""
        return self._feed.stats()

    def flush(self, timeout_s: float = 60.0) -> None:
        """Waits until the server has what was flown.

        Raises:
            CurriculumError: It has not after this time, or refuses some of it.
        """
        self._feed.flush(timeout_s)

    def close(self, timeout_s: float = 60.0) -> None:
        """Hands in what was flown and gives back what was not. The curriculum itself is its owner's to close.

        Raises:
            CurriculumError: What was flown could not be handed in, or was refused.
        """
        self._feed.close(timeout_s)

    def __enter__(self) -> Environments:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _board(self, group_id: str) -> Seat:
        """The environment of the next sibling of a group, its episode begun, and whether to learn from that."""
        with self._lock:
            if group_id not in self._begun:
                self._begun[group_id] = self._begin()
            waiting = self._begun[group_id]
            taken = waiting.pop()
            if not waiting:
                del self._begun[group_id]
            return taken

    def _begin(self) -> list[Seat]:
        group: list[Seat] = []
        try:
            while len(group) < self.siblings:
                flown = self._idle.pop() if self._idle else Environment(curriculum=self._feed, axes="world")
                told = flown.reset()[1]
                # Siblings follow each other. Where a group was torn, by an interrupt amid it, say, the next begins here.
                if group and told["scenario"] != group[0][0].scenario:
                    self._tear(group)
                group.append((flown, told["train"]))
        except BaseException:
            self._tear(group)
            raise
        return group

    def _tear(self, group: list[Seat]) -> None:
        for flown, _ in group:
            self._give_up(flown)
        group.clear()

    def _give_up(self, flown: Environment) -> None:
        # An episode that was begun again would be flown amid another group.
        flown._abandon()
        self._idle.append(flown)

    def _leave(self, flown: Environment, over: bool) -> None:
        with self._lock:
            if over:
                self._idle.append(flown)
            else:
                self._give_up(flown)


class Pilot:
    """One sibling: its public methods are the tools of the model."""

    def __init__(self, environments: Environments) -> None:
        self._environments = environments
        self._flown: Environment | None = None
        self._train = True
        self._over = False
        self._score = 0.0
        self._steps = 0

    def reset(self, group_id: str = "", **_: Any) -> str:
        """Begins an episode: of the scenario that the siblings with this `group_id` fly. What is seen comes back, after the goal.

        Raises:
            CurriculumError: There is nothing to fly: the server is away, or refuses.
        """
        if self._flown is not None:
            self._environments._leave(self._flown, self._over)
            self._flown = None
        self._flown, self._train = self._environments._board(group_id)
        self._over, self._score, self._steps = False, 0.0, 0
        return f"{self._telemetry()['mission_objective']}\n{self._seen(self._environments.near)}"

    def fire_thrusters(self, satellite_id: int, delta_vx: float, delta_vy: float) -> str:
        """
        Changes the velocity of one satellite, and lets one step pass.

        Args:
            satellite_id: Which satellite, 0 to 2.
            delta_vx: Change of its velocity along x, -1 to 1.
            delta_vy: Change of its velocity along y, -1 to 1.

        Returns:
            What is seen then.
        """
        if isinstance(satellite_id, bool) or satellite_id not in (0, 1, 2):
            raise ValueError(f"satellite_id: {satellite_id!r} is not 0, 1 or 2")
        burn = np.zeros((3, 2), np.float32)
        burn[int(satellite_id)] = np.clip((_number("delta_vx", delta_vx), _number("delta_vy", delta_vy)), -1.0, 1.0)
        self._step(burn)
        return self._seen(self._environments.near)

    def hold(self, steps: int) -> str:
        """
        Does nothing for some steps.

        Args:
            steps: How many, 1 to 50.

        Returns:
            What is seen then.
        """
        count = _number("steps", steps)
        if count < 1:
            raise ValueError(f"steps: {steps!r} is not from 1 to 50")
        self._hold(int(min(count, 50)))
        return self._seen(self._environments.near)

    def telemetry(self) -> str:
        """
        Looks farther around. No time passes.

        Returns:
            What is seen now.
        """
        return self._seen(FAR)

    def get_reward(self) -> float:
        """What the episode earned, after the steps that are left are flown by holding: a short answer is no way out.

        Where the curriculum only wants to know how a scenario goes (`train` of its lease), all siblings get 0, so that nothing
        is learnt from it.
        """
        flown = self._at()
        while not self._over:
            self._hold(50)
        if not self._train:
            return 0.0
        if self._environments.reward == "score":
            return self._score
        assert flown.scenario is not None
        return _bracket(flown.scenario).skill(self._score) or 0.0

    @property
    def scenario(self) -> Scenario | None:
        """What is flown; none before the first reset."""
        return None if self._flown is None else self._flown.scenario

    @property
    def over(self) -> bool:
        """The episode is flown to its end."""
        return self._over

    @property
    def score(self) -> float:
        """The score so far."""
        return self._score

    def _at(self) -> Environment:
        if self._flown is None:
            raise ResetNeeded("nothing flies: call reset first")
        return self._flown

    def _telemetry(self) -> dict[str, Any]:
        return self._at().telemetry() or {}

    def _hold(self, steps: int) -> None:
        for _ in range(steps):
            self._step(np.zeros((3, 2), np.float32))
            if self._over:
                return

    def _step(self, action: npt.NDArray[np.float32]) -> None:
        flown = self._at()
        if self._over:
            # Told to the model: it has nothing left to do.
            raise ValueError(f"the episode is over; its score is {self._score:.3f}")
        _, _, terminated, truncated, info = flown.step(action)
        self._score, self._over, self._steps = info["score"], terminated or truncated, self._steps + 1

    def _seen(self, most: int) -> str:
        if self._over:
            alerts = [str(alert) for alert in self._telemetry()["critical_alerts"]]
            return "\n".join([*alerts, f"The episode is over; its score is {self._score:.3f}."])
        return f"Step {self._steps}.\n{words(self._telemetry(), most)}"


def _number(name: str, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{name}: {value!r} is not a number")
    return number


_bracket = lru_cache(maxsize=256)(bracket)


class CurriculumCallback(TrainerCallback):
    """Counts the policy's version up with the trainer's steps, and writes the curriculum's numbers wherever the trainer logs:
    mastery, level, params, skill, the share of groups without variance.

    They are in the trainer's log as `curriculum/…`, and in TensorBoard, where `report_to` has that, as a run `curriculum` beside
    the trainer's own. Callbacks are told in order, and those of `report_to` come first: for others of them, as Weights & Biases,
    say `report_to="none"` and `callbacks=[CurriculumCallback(envs), WandbCallback()]`.

    Args:
        followed: What the trainer's `environment_factory` is; or a curriculum, for environments of your own.
    """

    def __init__(self, followed: Environments | Curriculum) -> None:
        self.followed = followed
        self._before = 0
        self._writer: Any = None

    def on_train_begin(self, args: Any, state: Any, control: Any, **_: Any) -> None:
        """
        Raises:
            ValueError: Settings of the trainer by which siblings would fly apart.
        """
        if isinstance(self.followed, Environments):
            _check(args, self.followed.siblings)
        # A run that goes on has policies already: a new training counts on from the newest of them.
        self._before = max(0, self.followed.policy_version - state.global_step)
        self.followed.policy_version = self._before + state.global_step
        if state.is_world_process_zero and "tensorboard" in args.report_to:
            from torch.utils.tensorboard import SummaryWriter

            runs = os.environ.get("TENSORBOARD_LOGGING_DIR") or os.path.join(args.output_dir, "runs")
            self._writer = SummaryWriter(os.path.join(runs, "curriculum"))

    def on_step_end(self, args: Any, state: Any, control: Any, **_: Any) -> None:
        """What is flown from here on is by a policy that has learnt."""
        self.followed.policy_version = self._before + state.global_step

    def on_log(self, args: Any, state: Any, control: Any, logs: dict[str, Any] | None = None, **_: Any) -> None:
        """Adds the numbers to what is logged."""
        if not state.is_world_process_zero or logs is None:
            return
        try:
            numbers = {f"curriculum/{name}": value for name, value in self.followed.numbers().items()}
        except CurriculumError as error:
            # Hours of training are worth more than a point of a curve.
            logger.warning("no numbers of the curriculum: %s", error)
            return
        logs.update(numbers)
        if state.log_history:
            state.log_history[-1].update(numbers)
        if self._writer is not None:
            for name, value in numbers.items():
                self._writer.add_scalar(name, value, state.global_step)
            self._writer.flush()

    def on_train_end(self, args: Any, state: Any, control: Any, **_: Any) -> None:
        """Closes what it wrote."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None


def _check(args: Any, siblings: int) -> None:
    if args.num_generations != siblings:
        raise ValueError(f"num_generations: {args.num_generations}, where the groups have {siblings} siblings")
    together = args.per_device_train_batch_size * args.steps_per_generation
    if together % siblings:
        raise ValueError(
            f"per_device_train_batch_size: each process generates {together} episodes at once, which are no whole groups of "
            f"{siblings}: siblings have to fly in one process"
        )
    if args.eval_strategy != "no":
        raise ValueError("eval_strategy: what is flown for it would count as training")
