"""Discounts by time agree with sums that are written out, and with plain discounts for equal durations."""

import numpy as np
import pytest

import sparring
from sparring.discounting import advantages, discounted_returns, time_discounts

RNG = np.random.default_rng(3)
REWARDS = RNG.normal(size=(7, 2))
VALUES = RNG.normal(size=(7, 2))
DURATIONS = RNG.uniform(1.0, 300.0, size=(7, 2))
ENDS = np.zeros((7, 2), bool)
ENDS[3, 0] = True


def test_returns_equal_the_sums():
    returns = discounted_returns(REWARDS, DURATIONS, ENDS, 0.999, last_values=[0.5, -2.0])
    for env in range(2):
        for first in range(7):
            total, discount = 0.0, 1.0
            for step in range(first, 7):
                total += discount * REWARDS[step, env]
                discount *= 0.999 ** DURATIONS[step, env]
                if ENDS[step, env]:
                    break
            else:
                total += discount * [0.5, -2.0][env]
            assert returns[first, env] == pytest.approx(total, rel=1e-12)


def test_advantages_of_lambda_one_are_returns_less_values():
    returns = discounted_returns(REWARDS, DURATIONS, ENDS, 0.99, last_values=[1.0, 1.0])
    estimates = advantages(REWARDS, VALUES, DURATIONS, ENDS, 0.99, 1.0, last_values=[1.0, 1.0])
    np.testing.assert_allclose(estimates, returns - VALUES, atol=1e-12)


def test_lambda_zero_is_the_error_of_one_step():
    estimates = advantages(REWARDS, VALUES, DURATIONS, ENDS, 0.99, 0.0, last_values=[0.0, 0.0])
    following = np.vstack([VALUES[1:], np.zeros((1, 2))]) * ~ENDS
    np.testing.assert_allclose(estimates, REWARDS + 0.99**DURATIONS * following - VALUES, atol=1e-12)


def test_durations_of_an_episode_are_those_of_the_infos():
    env = sparring.Environment("tasking/scanning", params={"time_limit_s": 1800.0})
    env.reset(seed=2)
    rewards, durations, ends = [], [], []
    while not (ends and ends[-1]):
        _, reward, terminated, truncated, info = env.step([1])
        rewards.append(reward), durations.append(info["d_ts"]), ends.append(terminated or truncated)
    assert sum(durations) == 1800.0
    assert discounted_returns(rewards, durations, ends, 1.0)[0] == pytest.approx(sum(rewards))


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        ({"gamma_s": 0.0}, "gamma_s"),
        ({"gamma_s": 1.5}, "gamma_s"),
        ({"gamma_s": float("nan")}, "gamma_s"),
        ({"d_ts": -DURATIONS}, "d_ts"),
        ({"d_ts": DURATIONS[:3]}, "d_ts"),
        ({"ends": ENDS[:, :1]}, "ends"),
        ({"values": VALUES[0]}, "values"),
        ({"gae_lambda": 2}, "gae_lambda"),
    ],
)
def test_invalid_arguments_are_named(arguments, field):
    valid = {"rewards": REWARDS, "values": VALUES, "d_ts": DURATIONS, "ends": ENDS, "gamma_s": 0.99, "gae_lambda": 0.9}
    with pytest.raises(ValueError, match=f"`{field}` must be"):
        advantages(**{**valid, **arguments})


def test_discount_of_no_time_is_one():
    assert time_discounts(0.0, 0.5) == 1.0
