"""Images have the right size, are deterministic, and show the state."""

import os

import gymnasium
import numpy as np
import pytest

import sparring


def test_images_change_and_are_deterministic(task):
    def render_steps():
        env = sparring.Environment(task, render_mode="rgb_array", render_size=(300, 200))
        env.reset(seed=3)
        images = [env.render()]
        for _ in range(3):
            env.step(np.full(env.action_space.shape, 0 if sparring.task(task).action_names else 0.5, env.action_space.dtype))
            images.append(env.render())
        return images

    first = render_steps()
    assert all(image.shape == (200, 300, 3) and image.dtype == np.uint8 for image in first)
    assert not np.array_equal(first[0], first[1])
    assert all(np.array_equal(a, b) for a, b in zip(first, render_steps(), strict=True))


def test_image_shows_earth_and_satellites_at_their_positions():
    env = sparring.Environment("kessler/survival", render_mode="rgb_array", observation="telemetry")
    observation, _ = env.reset(seed=3)
    image = env.render()
    scale = (640 / 2 - 8) / 108
    assert tuple(image[320, 320]) == (38, 74, 120)
    colors = [(86, 180, 233), (230, 159, 0), (0, 200, 150)]
    for color, (x, y) in zip(colors, observation["satellites"][:, :2], strict=True):
        assert tuple(image[round(320 - y * scale), round(320 + x * scale)]) == color


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


def test_human_mode_opens_a_window(monkeypatch):
    pytest.importorskip("pygame")
    monkeypatch.setitem(os.environ, "SDL_VIDEODRIVER", "dummy")
    env = gymnasium.make("sparring/DockingMultiagent-v0", render_mode="human")
    env.reset(seed=1)
    env.step(env.action_space.sample())
    assert env.render() is None
    env.close()


def test_render_before_reset_is_rejected():
    env = sparring.Environment(render_mode="rgb_array")
    with pytest.raises(ValueError, match="reset"):
        env.render()
    envs = sparring.make_vec(num_envs=2, render_mode="rgb_array")
    envs.reset(seed=1)
    assert [image.shape for image in envs.render()] == [(320, 320, 3)] * 2
