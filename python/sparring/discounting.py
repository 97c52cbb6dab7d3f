"""Discounts by time, for tasks whose steps have different durations (semi-Markov decision processes).

The value of a state is the sum of later rewards, each discounted by the time until its step begins: V = r + gamma^d V', with the
duration d of the step in seconds (Bradtke and Duff 1994, *Reinforcement Learning Methods for Continuous-Time Markov Decision
Problems*). The reward of a step is not discounted within it, as in BSK-RL.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from .errors import invalid


def time_discounts(d_ts: npt.ArrayLike, gamma_s: float) -> npt.NDArray[np.float64]:
    """Returns the discount of each step, gamma_s ** d_ts.

    Args:
        d_ts: Durations of steps, s: `info["d_ts"]` of any shape.
        gamma_s: Discount of a second, above 0 and up to 1. Half of a value is left after ln 0.5 / ln gamma_s seconds.

    Raises:
        ValueError: The discount or a duration is out of range.

    >>> time_discounts([0.0, 600.0], 0.999).round(3)
    array([1.   , 0.549])
    """
    if isinstance(gamma_s, bool) or not 0.0 < gamma_s <= 1.0:
        raise invalid("gamma_s", "a number above 0 and up to 1", gamma_s)
    durations = np.asarray(d_ts, np.float64)
    if not (np.isfinite(durations) & (durations >= 0.0)).all():
        raise invalid("d_ts", "durations of at least 0 s", d_ts)
    return np.power(gamma_s, durations)


def discounted_returns(
    rewards: npt.ArrayLike,
    d_ts: npt.ArrayLike,
    ends: npt.ArrayLike,
    gamma_s: float,
    last_values: npt.ArrayLike = 0.0,
) -> npt.NDArray[np.float64]:
    """Returns the discounted sum of rewards from each step on.

    Args:
        rewards: Rewards, steps × any shape.
        d_ts: Durations of the steps, s, of the same shape.
        ends: True where a step ends an episode, of the same shape.
        gamma_s: Discount of a second.
        last_values: Values of the states after the last step, where no episode has ended.

    Raises:
        ValueError: The shapes differ, or the discount or a duration is out of range.
    """
    values = np.zeros_like(np.asarray(rewards, np.float64))
    return advantages(rewards, values, d_ts, ends, gamma_s, 1.0, last_values)


def advantages(
    rewards: npt.ArrayLike,
    values: npt.ArrayLike,
    d_ts: npt.ArrayLike,
    ends: npt.ArrayLike,
    gamma_s: float,
    gae_lambda: float,
    last_values: npt.ArrayLike = 0.0,
) -> npt.NDArray[np.float64]:
    """Returns generalised advantage estimates (Schulman et al. 2016) with discounts by time.

    Args:
        rewards: Rewards, steps × any shape.
        values: Values of the states before the steps, of the same shape.
        d_ts: Durations of the steps, s, of the same shape.
        ends: True where a step ends an episode, of the same shape.
        gamma_s: Discount of a second.
        gae_lambda: Share by which the estimate of a step depends on that of the next one, from 0 to 1.
        last_values: Values of the states after the last step, where no episode has ended.

    Raises:
        ValueError: The shapes differ, or a number is out of range.
    """
    reward, value, flags = np.asarray(rewards, np.float64), np.asarray(values, np.float64), np.asarray(ends, np.bool_)
    discounts = time_discounts(d_ts, gamma_s)
    for name, array in (("values", value), ("d_ts", discounts), ("ends", flags)):
        if array.shape != reward.shape:
            raise invalid(name, f"an array of shape {reward.shape}, that of `rewards`", array.shape)
    if isinstance(gae_lambda, bool) or not 0.0 <= gae_lambda <= 1.0:
        raise invalid("gae_lambda", "a number from 0 to 1", gae_lambda)
    estimates = np.zeros_like(reward)
    following: Any = np.broadcast_to(np.asarray(last_values, np.float64), reward.shape[1:])
    estimate: Any = np.zeros(reward.shape[1:])
    for step in range(len(reward) - 1, -1, -1):
        goes_on = discounts[step] * ~flags[step]
        estimate = reward[step] + goes_on * following - value[step] + goes_on * gae_lambda * estimate
        estimates[step], following = estimate, value[step]
    return estimates
