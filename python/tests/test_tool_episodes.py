"""Episodes that language models control by tools, without a trainer."""

import numpy as np
import pytest

import sparring
from sparring.docking_episode import DockingEpisode, describe_docking
from sparring.tool_episode import ToolEpisode


class LocalEpisode:
    """Runs the steps of an episode in an environment of this process."""

    def __init__(self, env, **options):
        super().__init__(**options)
        self.env = env

    def begin(self, seed):
        self.env.reset(seed=seed)
        return self._begin()

    def _advance(self, actions):
        _, _, terminated, truncated, info = self.env.step(actions)
        self._score, self._over = info["score"], terminated or truncated

    def _telemetry(self):
        return self.env.telemetry()


class LocalKessler(LocalEpisode, ToolEpisode):
    """Episode of kessler in this process."""


class LocalDocking(LocalEpisode, DockingEpisode):
    """Episode of docking in this process."""

    def _hold_action(self):
        return np.zeros(self.env.action_space.shape, np.float32)


def test_tools_of_kessler_run_the_episode():
    episode = LocalKessler(sparring.Environment("kessler/survival", axes="world"), max_debris=2)
    text = episode.begin(3)
    assert text.startswith("SURVIVAL: ") and "\nStep 0.\n" in text
    assert len(episode.telemetry()) > len(text)
    assert "Step 1." in episode.fire_thrusters(2, "0.5", -7)
    np.testing.assert_array_equal(episode.env.history[0], [[0, 0], [0, 0], [0.5, -1]])
    assert "Step 11." in episode.hold(10)
    assert "The episode is over" in episode.hold(50) and episode.over
    assert "The episode is over" in episode.telemetry()
    with pytest.raises(ValueError, match="its score is"):
        episode.hold(1)


def test_tools_of_docking_run_the_episode():
    episode = LocalDocking(sparring.Environment("docking/multiagent", params={"deputies": 2, "time_limit_s": 100}))
    assert "\nSecond 0 of 100, thrust at most 1.00 N along each axis\n" in episode.begin(1)
    assert "Second 7 of 100" in episode.thrust(1, 0.25, 0, -2, 7)
    assert (episode.env.history == [[0, 0, 0], [0.25, 0, -1]]).all() and len(episode.env.history) == 7
    assert "Second 57 of 100" in episode.coast(50)
    episode._finish()
    assert episode.over and episode.score < 0
    assert "The episode is over" in episode._describe()


@pytest.mark.parametrize(
    ("field", "value"), [("deputy_id", 2), ("deputy_id", True), ("thrust_x", "a"), ("thrust_z", float("nan")), ("seconds", 0.5)]
)
def test_invalid_argument_of_a_tool_is_named(field, value):
    episode = LocalDocking(sparring.Environment("docking/multiagent", params={"deputies": 2}))
    episode.begin(1)
    valid = {"deputy_id": 0, "thrust_x": 0.1, "thrust_y": 0.0, "thrust_z": 0.0, "seconds": 1}
    with pytest.raises(ValueError, match=f"`{field}` must be"):
        episode.thrust(**{**valid, field: value})
    assert len(episode.env.history) == 0


def test_docked_deputy_is_described():
    env = sparring.Environment("docking/multiagent", params={"deputies": 2})
    env.reset(seed=1)
    policy = sparring.policy("reference", env.scenario)
    texts, over = [], False
    while not over:
        texts.append(describe_docking(env.telemetry()))
        *_, terminated, truncated, _ = env.step(policy.act(env.telemetry()))
        over = terminated or truncated
    assert "Deputy 1 at (" in texts[0] and "- deputy 0 is " in texts[0]
    assert any("has left: docked" in text for text in texts)
