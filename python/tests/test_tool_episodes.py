"""Episodes that language models control by tools, without a trainer."""

import numpy as np
import pytest

import sparring
from sparring.docking_episode import DockingEpisode, describe_docking
from sparring.tasking_episode import ImagingEpisode, ScanningEpisode
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


class LocalScanning(LocalEpisode, ScanningEpisode):
    """Episode of tasking/scanning in this process."""


class LocalImaging(LocalEpisode, ImagingEpisode):
    """Episode of a task with targets in this process."""


def test_tools_of_scanning_run_the_episode():
    episode = LocalScanning(sparring.Environment("tasking/scanning", params={"time_limit_s": 1200}))
    assert "\nSecond 0 of 1200, score 0.000.\nSatellite 0 needs an action. Battery " in episode.begin(3)
    for action, second in [("scan", 180), ("charge", 300), ("downlink", 360), ("desaturate", 420), ("scan", 600)]:
        text = getattr(episode, action)(0)
        assert text.startswith(f"Second {second} of 1200, score ") and text == episode.telemetry()
    assert "Second 1200" not in episode.wait()
    episode._finish()
    assert episode.over and episode.score > 0
    names = sparring.task("tasking/scanning").action_names
    given = [names[int(index)] for index in np.ravel(episode.env.history[:5])]
    assert given == ["scan", "charge", "downlink", "desaturate", "scan"]
    with pytest.raises(ValueError, match="its score is"):
        episode.scan(0)


def test_time_passes_when_all_satellites_have_an_action():
    params = {"satellites": 2, "time_limit_s": 1800, "targets": 300}
    episode = LocalImaging(sparring.Environment("tasking/constellation", params=params))
    assert "- target 9: priority " in episode.begin(5)
    assert episode.charge(1) == "Satellite 1 will charge. These satellites need an action, too: 0."
    assert "Second 60 of 1800" in episode.downlink(0)
    assert "Satellite 1 is busy: charge." in episode.telemetry()
    with pytest.raises(ValueError, match="satellite 1 is busy; satellites that need an action: 0"):
        episode.charge(1)
    text = episode.image(0, 2)
    assert text.startswith("Second ") and len(episode.env.history) == 2
    np.testing.assert_array_equal(episode.env.history, [[[11], [10]], [[2], [-1]]])


@pytest.mark.parametrize(("field", "value"), [("satellite_id", 1), ("satellite_id", True), ("target", 10), ("target", "a")])
def test_invalid_argument_of_a_tasking_tool_is_named(field, value):
    episode = LocalImaging(sparring.Environment("tasking/imaging"))
    episode.begin(1)
    with pytest.raises(ValueError, match=f"`{field}` must be"):
        episode.image(**{"satellite_id": 0, "target": 0, field: value})
    assert len(episode.env.history) == 0
