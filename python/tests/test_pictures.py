"""Pictures: of the right size, the same again, and of what happens."""

import os

import gymnasium
import numpy as np
import pytest

import sparring


def test_pictures_move_and_are_the_same_again(task):
    def drawn():
        env = sparring.Environment(task, render_mode="rgb_array", render_size=(300, 200))
        env.reset(seed=3)
        pictures = [env.render()]
        for _ in range(3):
            env.step(np.full(env.action_space.shape, 0.5, np.float32))
            pictures.append(env.render())
        return pictures

    first = drawn()
    assert all(picture.shape == (200, 300, 3) and picture.dtype == np.uint8 for picture in first)
    assert not np.array_equal(first[0], first[1])
    assert all(np.array_equal(a, b) for a, b in zip(first, drawn(), strict=True))


def test_the_earth_and_the_satellites_are_where_they_are():
    env = sparring.Environment("kessler/survival", render_mode="rgb_array", observation="telemetry")
    seen, _ = env.reset(seed=3)
    picture = env.render()
    scale = (640 / 2 - 8) / 108
    assert tuple(picture[320, 320]) == (38, 74, 120)
    for colour, (x, y) in zip([(86, 180, 233), (230, 159, 0), (0, 200, 150)], seen["satellites"][:, :2], strict=True):
        assert tuple(picture[round(320 - y * scale), round(320 + x * scale)]) == colour


def test_gymnasium_records_a_video(tmp_path):
    pytest.importorskip("moviepy")
    env = gymnasium.make("sparring/Survival-v0", render_mode="rgb_array")
    env = gymnasium.wrappers.RecordVideo(env, str(tmp_path / "videos"), disable_logger=True)
    env.reset(seed=1)
    over = False
    while not over:
        *_, terminated, truncated, _ = env.step(env.action_space.sample())
        over = terminated or truncated
    env.close()
    assert [path for path in (tmp_path / "videos").iterdir() if path.suffix == ".mp4" and path.stat().st_size > 5000]


def test_a_window(monkeypatch):
    pytest.importorskip("pygame")
    monkeypatch.setitem(os.environ, "SDL_VIDEODRIVER", "dummy")
    env = gymnasium.make("sparring/DockingMultiagent-v0", render_mode="human")
    env.reset(seed=1)
    env.step(env.action_space.sample())
    assert env.render() is None
    env.close()


def test_before_the_first_reset_there_is_nothing_to_draw():
    env = sparring.Environment(render_mode="rgb_array")
    with pytest.raises(ValueError, match="reset"):
        env.render()
    envs = sparring.make_vec(num_envs=2, render_mode="rgb_array")
    envs.reset(seed=1)
    assert [picture.shape for picture in envs.render()] == [(320, 320, 3)] * 2
