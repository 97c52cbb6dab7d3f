"""Stable-Baselines3: ends of episodes, its evaluations and wrappers, and algorithms other than PPO."""

import warnings

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from stable_baselines3 import A2C, DQN, PPO, SAC
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecFrameStack, VecMonitor, VecNormalize

import sparring
import sparring.sb3

SEED = 3
ENVS = 8
#: Satellites of an environment.
AGENTS = 3


class Hold:
    """Policy whose satellites do nothing."""

    def predict(self, observations, state=None, episode_start=None, deterministic=True):
        return np.zeros((len(observations), 2), np.float32), state


def survival(envs=ENVS, **settings):
    """Returns seeded environments in which hold loses satellites before an episode ends."""
    made = sparring.sb3.vec_env(envs, "kessler/survival", level=5, **settings)
    made.seed(SEED)
    return made


def team_episodes(episodes):
    """Returns returns and lengths of each environment's first episodes, once per satellite, sorted by return."""
    envs = sparring.make_vec("kessler/survival", ENVS, level=5)
    envs.reset(seed=SEED)
    hold = np.zeros(envs.action_space.shape, np.float32)
    ended = [[] for _ in range(ENVS)]
    while min(map(len, ended)) < episodes:
        *_, infos = envs.step(hold)
        for env in np.flatnonzero(infos.get("_episode", np.zeros(ENVS, bool))):
            ended[env].append((infos["episode"]["r"][env], infos["episode"]["l"][env]))
    return sorted(episode for env in ended for episode in env[:episodes] * AGENTS)


def evaluate_hold(envs, episodes):
    """Returns returns and lengths of the rows' first episodes by `evaluate_policy`, sorted by return."""
    returns, lengths = evaluate_policy(Hold(), envs, episodes * ENVS * AGENTS, return_episode_rewards=True)
    return sorted(zip(returns, lengths, strict=True))


def test_each_row_is_done_once_with_its_episode():
    envs = survival()
    envs.reset()
    hold = np.zeros((envs.num_envs, 2), np.float32)
    lengths, ended, lost = np.zeros(ENVS, int), [], 0
    for _ in range(300):
        lost += (~envs.next_active).sum()
        _, _, dones, infos = envs.step(hold)
        assert all(("terminal_observation" in info) == done for info, done in zip(infos, dones, strict=True))
        dones = dones.reshape(ENVS, AGENTS)
        assert (dones == dones[:, :1]).all(), "rows of an environment are done together"
        lengths += 1
        ended += lengths[dones[:, 0]].tolist()
        lengths[dones[:, 0]] = 0
    assert lost > 100, "hold loses satellites before their episodes end"
    assert len(ended) > 5 * ENVS
    assert min(ended) > 1


@pytest.mark.parametrize("source", ["infos", "rewards"])
@pytest.mark.parametrize("episodes", [1, 4])
def test_evaluate_policy_reports_team_returns(episodes, source, monkeypatch):
    if source == "rewards":  # without a monitor, `evaluate_policy` sums the rewards of each row
        monkeypatch.setattr(sparring.sb3.AgentsVecEnv, "env_is_wrapped", lambda envs, *_: [False] * envs.num_envs)
    with warnings.catch_warnings():
        warnings.simplefilter("error" if source == "infos" else "ignore")
        assert evaluate_hold(survival(), episodes) == team_episodes(episodes)


@pytest.mark.parametrize("wrapper", [VecMonitor, VecNormalize, VecFrameStack])
def test_wrapped_rows_report_team_returns(wrapper):
    settings = {"n_stack": 4} if wrapper is VecFrameStack else {}
    with warnings.catch_warnings():
        # `VecMonitor` warns that it replaces `episode` of the infos; `VecFrameStack` warns without `terminal_observation`.
        warnings.simplefilter("ignore" if wrapper is VecMonitor else "error")
        envs = wrapper(survival(), **settings)
        evaluated = evaluate_hold(envs, 2)
    # `VecMonitor` sums in single precision.
    assert np.array(evaluated) == pytest.approx(np.array(team_episodes(2)), rel=1e-5)


@pytest.mark.parametrize("wrapper", [VecFrameStack, VecNormalize])
def test_wrapped_terminal_observations_equal_observations(wrapper):
    envs = wrapper(survival(), n_stack=4) if wrapper is VecFrameStack else wrapper(survival(), training=False)
    plain = survival()
    envs.reset()
    plain.reset()
    hold = np.zeros((envs.num_envs, 2), np.float32)
    ended = 0
    for _ in range(60):
        _, _, dones, infos = envs.step(hold)
        *_, plain_infos = plain.step(hold)
        for row in np.flatnonzero(dones):
            final, expected = infos[row]["terminal_observation"], plain_infos[row]["terminal_observation"]
            assert final.shape == envs.observation_space.shape
            expected = envs.normalize_obs(expected) if wrapper is VecNormalize else expected
            assert (final[-len(expected) :] == expected).all()
            ended += 1
    assert ended >= ENVS * AGENTS


def test_deputies_have_their_own_returns_in_vec_monitor():
    params = {"time_limit_s": 60.0, "start_radius": 10.0}
    team, own = [], []
    for wrapper, returns in ((lambda envs: envs, team), (VecMonitor, own)):
        envs = sparring.sb3.vec_env(4, "docking/multiagent", params=params)
        envs.seed(SEED)
        envs = wrapper(envs)
        envs.reset()
        rng = np.random.default_rng(SEED)
        while len(returns) < 48:
            actions = rng.uniform(-1, 1, (envs.num_envs, *envs.action_space.shape)).astype(np.float32)
            _, _, dones, infos = envs.step(actions)
            returns += [[info["episode"]["r"] for info in infos[env : env + AGENTS]] for env in np.flatnonzero(dones)[::AGENTS]]
    assert (np.ptp(team, axis=1) == 0).all()
    assert (np.ptp(own, axis=1) > 0).any()
    # The team's return is the mean of the deputies' returns.
    assert np.mean(own, axis=1) == pytest.approx(np.mean(team, axis=1), abs=1e-4)


def test_eval_callback_reports_returns_of_evaluate_policy(tmp_path):
    model = PPO("MlpPolicy", survival(2), n_steps=50, batch_size=300, learning_rate=0.0, device="cpu", seed=1)
    # The policy does not change, so both evaluations of the callback can be repeated.
    callback = EvalCallback(survival(), n_eval_episodes=24, eval_freq=25, log_path=tmp_path, verbose=0)
    model.learn(300, callback=callback)
    repeated = survival()
    expected = [evaluate_policy(model, repeated, 24, return_episode_rewards=True) for _ in range(2)]
    assert callback.evaluations_results == [returns for returns, _ in expected]
    assert callback.evaluations_length == [lengths for _, lengths in expected]
    assert callback.last_mean_reward == np.mean(expected[1][0])


def test_logged_returns_are_those_of_the_team():
    model = PPO("MlpPolicy", survival(2), n_steps=100, batch_size=600, device="cpu", seed=1)
    model.learn(600)
    logged = [episode["r"] for episode in model.ep_info_buffer]
    assert len(logged) >= 2 * AGENTS
    # Each episode counts once per satellite.
    assert logged[::AGENTS] == logged[1::AGENTS] == logged[2::AGENTS]


@pytest.mark.parametrize("algorithm", [DQN, A2C, SAC])
def test_other_algorithms_learn(algorithm):
    envs = survival(2, actions="discrete" if algorithm is DQN else "continuous")
    settings = sparring.sb3.active_only(envs) if algorithm is A2C else {"buffer_size": 2_000, "batch_size": 32}
    model = algorithm("MlpPolicy", envs, policy_kwargs={"net_arch": [16]}, device="cpu", seed=1, **settings)
    before = [weights.clone() for weights in model.policy.parameters()]
    model.learn(1800)
    assert any((old != new).any() for old, new in zip(before, model.policy.parameters(), strict=True))
    returns, lengths = evaluate_policy(model, envs, 6, return_episode_rewards=True)
    assert np.isfinite(returns).all()
    assert min(lengths) > 1


def test_replayed_transitions_end_with_the_episode():
    envs = survival(2, actions="discrete")
    model = DQN("MlpPolicy", envs, buffer_size=2_000, learning_starts=10_000, device="cpu", seed=1)
    model.learn(900)
    buffer = model.replay_buffer
    dones = buffer.dones[: buffer.pos].astype(bool).reshape(-1, 2, AGENTS)
    assert dones.any()
    assert (dones == dones[..., :1]).all()
    # A transition leads to the row of the next step, except at the end of an episode, where that row is of the next one.
    following, stored = buffer.observations[1 : buffer.pos], buffer.next_observations[: buffer.pos - 1]
    equal = (following == stored).all(axis=-1).reshape(-1, 2, AGENTS)
    assert (equal.all(axis=-1) == ~dones[:-1, :, 0]).all()
