"""Any argument is accepted or raises a ValueError that names the field. A rejected call changes nothing."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

import sparring

ENVS = 3
envs = sparring.make_vec("kessler/survival", ENVS)
envs.reset(seed=1)
discrete = sparring.make_vec("kessler/survival", ENVS, actions="discrete")
discrete.reset(seed=1)
SHAPE = (ENVS, 3, 2)

anything = st.one_of(
    arrays.arrays(
        arrays.scalar_dtypes(),
        st.one_of(st.just(SHAPE), st.just((ENVS, 3)), arrays.array_shapes(min_dims=0, max_dims=4, max_side=4)),
    ),
    st.none(),
    st.text(),
    st.floats(),
    st.lists(st.floats()),
    st.dictionaries(st.text(), st.integers()),
    st.just([[1], [2, 3]]),
    st.just(object()),
)


def is_valid(actions, is_discrete):
    """Returns True for numbers of the right shape: finite in single precision, or integers within the choices."""
    if not isinstance(actions, np.ndarray):
        return False
    if is_discrete:
        return actions.dtype.kind in "iu" and actions.shape == (ENVS, 3) and ((actions >= 0) & (actions < 17)).all()
    with np.errstate(all="ignore"):
        return actions.dtype.kind in "fiu" and actions.shape == SHAPE and np.isfinite(actions.astype(np.float32)).all()


@settings(max_examples=400, deadline=None)
@given(anything, st.booleans())
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_actions_are_stepped_or_rejected(actions, is_discrete):
    batch = discrete if is_discrete else envs
    before = [batch.state_hash(env) for env in range(ENVS)]
    if is_valid(actions, is_discrete):
        batch.step(actions)
    else:
        with pytest.raises(ValueError, match="actions"):
            batch.step(actions)
        assert before == [batch.state_hash(env) for env in range(ENVS)]


def test_strided_and_readonly_actions_are_accepted():
    wide = np.zeros((ENVS, 3, 4), np.float32)
    envs.step(wide[..., ::2])
    envs.step(np.asfortranarray(np.zeros(SHAPE, np.float32)))
    locked = np.zeros(SHAPE, np.float32)
    locked.setflags(write=False)
    envs.step(locked)
    envs.step(np.zeros(SHAPE, np.float64)[::-1])
    envs.step(np.zeros(SHAPE, ">f4"))
    envs.step(np.zeros(SHAPE, np.float16))


def make_out():
    return [envs.empty_observations(), np.zeros(ENVS), np.zeros(ENVS, bool), np.zeros(ENVS, bool)]


@pytest.mark.parametrize("place", range(4))
@pytest.mark.parametrize("defect", ["readonly", "dtype", "shape", "strides", "none", "order"])
def test_invalid_out_array_is_rejected(place, defect):
    out = make_out()
    if defect == "readonly":
        out[place].setflags(write=False)
    elif defect == "dtype":
        out[place] = out[place].astype(np.int16)
    elif defect == "shape":
        out[place] = out[place][:-1]
    elif defect == "strides":
        out[place] = np.repeat(out[place], 2, axis=0)[::2]
    elif defect == "order":
        if place:
            pytest.skip("an array of one dimension has one order")
        out[place] = np.asfortranarray(out[place])
    else:
        out[place] = None
    before = envs.state_hash(0)
    with pytest.raises(ValueError, match=rf"out\[{place}\]"):
        envs.step(np.zeros(SHAPE, np.float32), out=tuple(out))
    assert envs.state_hash(0) == before


def test_overlapping_out_arrays_are_rejected():
    out = make_out()
    out[3] = out[2]
    with pytest.raises(ValueError, match=r"out\[3\]"):
        envs.step(np.zeros(SHAPE, np.float32), out=tuple(out))
    with pytest.raises(ValueError, match="out"):
        envs.reset(out=np.zeros((ENVS, 3, 71), np.float32))
    envs.reset(seed=1)


@settings(max_examples=200, deadline=None)
@given(st.one_of(st.integers(), st.floats(), st.text(), st.lists(st.one_of(st.none(), st.integers()), max_size=4), st.booleans()))
def test_seed_is_accepted_or_rejected(seed):
    def is_valid_seed(value):
        return value is None or (not isinstance(value, bool) and isinstance(value, int) and 0 <= value < 2**51)

    if isinstance(seed, list):
        accepted = len(seed) == ENVS and all(map(is_valid_seed, seed))
    else:
        accepted = is_valid_seed(seed) and is_valid_seed(seed + ENVS - 1)
    if accepted:
        envs.reset(seed=seed)
    else:
        with pytest.raises(ValueError, match="seed"):
            envs.reset(seed=seed)


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        ({"task": "kessler/none"}, "task"),
        ({"num_envs": 0}, "num_envs"),
        ({"num_envs": -1}, "num_envs"),
        ({"num_envs": 2**20 + 1}, "num_envs"),
        ({"num_envs": 1.5}, "num_envs"),
        ({"params": {"debris": 1e9}}, "params.debris"),
        ({"params": {"debris": 1.5}}, "params.debris"),
        ({"params": {"debris": "many"}}, "params.debris"),
        ({"params": {"no": 1}}, "params.no"),
        ({"params": 5}, "params"),
        ({"physics": "point"}, "physics"),
        ({"layout": [1]}, "layout"),
        ({"physics": {"no": "x"}}, "physics.no"),
        ({"physics": {"contact": "x"}}, "physics.contact"),
        ({"layout": {"no": 1}}, "layout"),
        ({"layout": {"no": {1}}}, "scenario"),
        ({"level": 10}, "level"),
        ({"level": True}, "level"),
        ({"observation": "state"}, "observation"),
        ({"threats": 5000}, "threats"),
        ({"threats": -5}, "threats"),
        ({"look_ahead": 0}, "look_ahead"),
        ({"bodies": 4}, "bodies"),
        ({"observation": "telemetry", "bodies": 10**7}, "bodies"),
        ({"actions": "some"}, "actions"),
        ({"axes": "own"}, "axes"),
        ({"task": "docking/multiagent", "axes": "agent"}, "axes"),
        ({"autoreset_mode": "never"}, "autoreset_mode"),
        ({"threads": 0}, "threads"),
        ({"threads": 10**6}, "threads"),
        ({"render_mode": "human"}, "render_mode"),
        ({"render_size": (1, 1)}, "render_size"),
        ({"render_size": "big"}, "render_size"),
    ],
    ids=str,
)
def test_invalid_setting_is_named(arguments, field):
    with pytest.raises(ValueError, match=field):
        sparring.make_vec(**arguments)


def test_more_environments_than_memory_are_rejected():
    program = """
import resource, sparring
sparring.make_vec(num_envs=8192, observation="telemetry").reset(seed=1)
resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
try:
    sparring.make_vec(num_envs=2**20, observation="telemetry", params={"debris": 1000}, threads=1)
except MemoryError as error:
    print(error)
"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120)
    assert ended.stdout.startswith("`num_envs` must fit into memory: 1048576 environments take "), ended


def test_wrong_type_is_named():
    agents = sparring.parallel_env("survival")
    agents.reset(seed=1)
    with pytest.raises(ValueError, match="actions"):
        agents.step([1])
    for env in (envs, agents, sparring.Environment("survival")):
        with pytest.raises(ValueError, match="options"):
            env.reset(options=[1])
    with pytest.raises(ValueError, match=r"options\.params"):
        envs.reset(options={"params": 5})
    with pytest.raises(ValueError, match="out"):
        envs.step(np.zeros(SHAPE, np.float32), out=make_out())
    for env in (-1, ENVS, 0.5, True):
        for method in (envs.score, envs.scenario, envs.state_hash):
            with pytest.raises(ValueError, match="env"):
                method(env)


@settings(max_examples=100, deadline=None)
@given(anything)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_invalid_log_is_rejected(actions):
    scenario = sparring.Scenario("survival", seed=3)
    for read in (sparring.replay, sparring.critique):
        with pytest.raises(ValueError, match="actions"):
            read(scenario, actions)


plain = st.one_of(st.none(), st.booleans(), st.floats(), st.integers(), st.text())
words = st.one_of(st.sampled_from(["task", "params", "seed", "layout", "physics", "kessler/survival"]), st.text())
nested = st.recursive(
    plain, lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(words, inner, max_size=4)), max_leaves=8
)


@settings(max_examples=200, deadline=None)
@given(nested)
def test_dict_is_a_scenario_or_rejected(fields):
    if not isinstance(fields, dict):
        fields = {"task": "kessler/survival", "seed": 1, "layout": fields}
    try:
        scenario = sparring.Scenario.from_dict(fields)
    except ValueError:
        return
    assert sparring.Scenario.from_dict(scenario.to_dict()) == scenario


def test_threads_step_one_batch_in_turns():
    import threading

    batch = sparring.make_vec("kessler/survival", 128, threads=2)
    batch.reset(seed=1)
    actions = np.zeros(batch.action_space.shape, np.float32)
    failures = []

    def step():
        try:
            for _ in range(200):
                batch.step(actions)
        except BaseException as error:
            failures.append(error)

    threads = [threading.Thread(target=step) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures
