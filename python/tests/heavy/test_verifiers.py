"""The package sparring-verifiers with verifiers, a real server and scripted models. Run by hand:

    scripts/verifiers-venv
    cd python && SPARRING_BINARY=../target/debug/sparring ../target/verifiers-venv/bin/pytest -o addopts= \
        -o filterwarnings=default -p no:cacheprovider tests/heavy/test_verifiers.py
"""

import asyncio
import itertools
import multiprocessing
import subprocess
import time
from types import MethodType

import pytest
from chat_server import ChatServer, tool_call
from conftest import BINARY, needs_server
from curriculum_servers import kill_server, local_curriculum, wait_until
from documents import URL, code_blocks, replace_all

pytest.importorskip("verifiers.v1")
import sparring_verifiers
import verifiers.v1 as vf
from sparring_verifiers.rollouts import episode_source
from sparring_verifiers.session import Session
from sparring_verifiers.session_episode import TOOLS, tool_schemas
from transformers.utils import get_json_schema
from verifiers.v1.serve import EnvClient, env_config_data, serve_env

import sparring

pytestmark = needs_server

SETTINGS = {"tasks": ["kessler/survival"], "placement": False, "design": {"designer": "off"}, "group_size": 4}
FIRE = tool_call("fire_thrusters", satellite_id=0, delta_vx=0.9, delta_vy=-0.9)
#: Plans of the scripted model: nothing, a burn, calls with errors, and a whole episode.
PLANS = [
    [],
    [[FIRE], [FIRE, tool_call("hold", steps=3)]],
    [
        [tool_call("hold", steps=5), tool_call("fire_thrusters", satellite_id=7, delta_vx=0, delta_vy=0)],
        [tool_call("hold"), tool_call("fly", far=1), *({"name": "hold", "arguments": text} for text in ("{steps", "[1]"))],
        [tool_call("telemetry")],
    ],
    [[tool_call("hold", steps=50), FIRE], [FIRE]],
]
INVALID_CALLS = 5


@pytest.fixture(scope="module")
def curriculum():
    with local_curriculum(settings=SETTINGS) as opened:
        yield opened


@pytest.fixture(scope="module")
def model():
    chat = ChatServer(PLANS)
    with chat.serving() as address:
        chat.address = address
        yield chat


def roll_out(env, model, tasks, rollouts, timeout=300.0):
    """Runs the rollouts of tasks as `vf-eval` does; returns the traces of each task."""
    context = vf.ModelContext(
        client=vf.EvalClientConfig(base_url=model.address, api_key_var="NO_KEY"), model="scripted", sampling=vf.SamplingConfig()
    )

    async def run():
        async with env.serving():
            slots = [slot for task in tasks for slot in env.slots(task, rollouts)]
            return await asyncio.wait_for(asyncio.gather(*(env.run_slot(slot, context) for slot in slots)), timeout)

    traces = [trace for episode in asyncio.run(run()) for trace in episode.traces]
    return [traces[start : start + rollouts] for start in range(0, len(traces), rollouts)]


def stored(curriculum, trace):
    """Returns the server's episode of a rollout."""
    info = trace.info["sparring"]
    return curriculum.request("GET", f"/v1/runs/{info['run']}/episodes/{info['episode']}")


def values(groups, name):
    """Returns a field of all rollouts, group by group."""
    return [[trace.info["sparring"][name] for trace in group] for group in groups]


def flat(groups):
    """Returns the items of all groups."""
    return list(itertools.chain.from_iterable(groups))


def test_tools_have_the_schemas_of_transformers():
    for schema, tool in zip(tool_schemas(), TOOLS.values(), strict=True):
        expected = get_json_schema(MethodType(tool, tool))
        del expected["function"]["return"]
        assert schema == expected


def test_group_shares_a_scenario_and_rewards_are_the_servers(curriculum, model):
    before = curriculum.mastery()[0]["results"]["episodes"]
    env = sparring_verifiers.load_environment(curriculum.url, run=curriculum.run)
    assert not env.taskset.bounded
    tasks = list(env.taskset.take(3))
    assert len({task.key for task in tasks}) == 3
    groups = roll_out(env, model, tasks, 4)
    assert [len(set(group)) for group in values(groups, "scenario")] == [1, 1, 1]
    assert len({group[0] for group in values(groups, "scenario")}) == 3
    assert len(set(flat(values(groups, "episode")))) == 12
    assert set(flat(values(groups, "status"))) == {"counted"}
    for trace in flat(groups):
        episode = stored(curriculum, trace)
        assert trace.ok and trace.reward == trace.metrics["score"] == episode["score"]
        assert trace.metrics["success"] == episode["success"] and trace.metrics.get("skill") == episode["skill"]
        for name in ("steps", "fuel_used", "lost"):
            assert trace.metrics[name] == episode["outcome"][name], name
        assert trace.metrics["invalid_calls"] in (0, INVALID_CALLS)
    # Each plan has a rollout in each group on average: some burn, and some have invalid calls.
    for name in ("fuel_used", "invalid_calls"):
        assert len({trace.metrics[name] for trace in flat(groups)}) > 1, name
    assert curriculum.mastery()[0]["results"]["episodes"] == before + 12
    env.taskset.close()


def test_model_receives_tools_and_observations(curriculum):
    chat = ChatServer([PLANS[2], PLANS[3]])
    with chat.serving() as chat.address:
        env = sparring_verifiers.load_environment(curriculum.url, run=curriculum.run, max_debris=1, prompt="Fly.")
        ((first, second),) = roll_out(env, chat, list(env.taskset.take(1)), 2)
        env.taskset.close()
    assert all(request["tools"] == tool_schemas() for request in chat.requests)
    longest = max((request["messages"] for request in chat.requests), key=len)
    assert longest[0]["role"] == "user" and longest[0]["content"].startswith("Fly.\n\n") and "Step 0." in longest[0]["content"]
    results = [message["content"] for message in longest if message["role"] == "tool"]
    assert results[0].startswith("Step 5.")
    for text, part in zip(results[1:6], ["satellite_id", "steps", "'fly'", "JSON object", "JSON object"], strict=True):
        assert text.startswith("error: ") and part in text
    assert results[6].startswith("Step 5.") and results[6].count("- debris") > results[0].count("- debris")
    # The episode that is over ends the rollout without another answer, and the answer with text ends the other one.
    assert sorted(trace.num_turns for trace in (first, second)) == [1, 4]


def test_further_rollouts_of_a_row_take_further_groups(curriculum, model):
    env = sparring_verifiers.load_environment(curriculum.url, run=curriculum.run, group_size=2)
    tasks = list(env.taskset.take(1))
    (first,) = roll_out(env, model, tasks, 3)
    (second,) = roll_out(env, model, tasks, 3)
    scenarios = [trace.info["sparring"]["scenario"] for trace in first + second]
    assert all(trace.ok for trace in first + second)
    assert sorted(scenarios.count(scenario) for scenario in set(scenarios)) == [2, 2, 2]
    env.taskset.close()


def test_rollouts_wait_for_a_free_session(curriculum, model):
    # The server has 64 sessions for each client.
    env = sparring_verifiers.load_environment(curriculum.url, run=curriculum.run, group_size=80)
    (group,) = roll_out(env, model, list(env.taskset.take(1)), 80)
    assert all(trace.ok for trace in group)
    assert len({trace.info["sparring"]["scenario"] for trace in group}) == 1
    env.taskset.close()


def test_workers_of_an_env_server_share_a_group(curriculum, model):
    # prime-rl's orchestrator reads the rows, and sends each rollout to the least busy worker of a pool.
    env = sparring_verifiers.load_environment(curriculum.url, run=curriculum.run)
    processes = multiprocessing.get_context("spawn")
    addresses = processes.Queue()
    settings = {"config_data": env_config_data(env.config), "address": "tcp://127.0.0.1:0", "address_queue": addresses}
    server = processes.Process(target=serve_env, kwargs={"max_workers": 2, "elastic": False, **settings})
    server.start()

    async def run(task):
        client = EnvClient(addresses.get(timeout=120))
        await client.wait_for_server_startup()
        endpoint = vf.EvalClientConfig(base_url=model.address, api_key_var="NO_KEY")
        data = task.data.model_dump(mode="json")
        episodes = await asyncio.gather(*(client.run(endpoint, "scripted", vf.SamplingConfig(), data) for _ in range(4)))
        await client.close()
        return flat(episode.traces for episode in episodes)

    try:
        traces = asyncio.run(run(next(iter(env.taskset))))
    finally:
        server.terminate()
        server.join()
    assert all(trace.ok for trace in traces), [trace.errors for trace in traces]
    assert len({trace.info["sparring"]["scenario"] for trace in traces}) == 1
    assert len({trace.info["sparring"]["episode"] for trace in traces}) == 4
    assert [trace.reward for trace in traces] == [stored(curriculum, trace)["score"] for trace in traces]


def test_limit_of_turns_or_context_ends_the_answers(curriculum):
    chat = ChatServer([[[FIRE]] * 20])
    with chat.serving() as chat.address:
        env = sparring_verifiers.load_environment(curriculum.url, run=curriculum.run, agent={"max_turns": 2})
        ((limited,),) = roll_out(env, chat, list(env.taskset.take(1)), 1)
        chat.status, chat.error = 400, "This model's maximum context length is 8 tokens."
        ((full,),) = roll_out(env, chat, list(env.taskset.take(1)), 1)
    assert (limited.num_turns, limited.stop_condition) == (2, "max_turns")
    for trace in (limited, full):
        assert trace.ok and trace.metrics["steps"] == 50 and trace.reward == stored(curriculum, trace)["score"]
    assert limited.metrics["fuel_used"] > 0 and full.metrics["fuel_used"] == 0
    env.taskset.close()


def test_lost_connection_is_resumed(curriculum):
    env = sparring_verifiers.load_environment(curriculum.url, run=curriculum.run)
    data = next(iter(env.taskset)).data
    begun = episode_source(data.url, 60.0).begin(data.row, max_debris=2)
    assert begun.episode.call("hold", {"steps": 3}).startswith("Step 3.")
    begun.episode._session._socket.close_socket()
    assert begun.episode.call("hold", {"steps": 2}).startswith("Step 5.")
    begun.episode._session._socket.close_socket()
    assert begun.finish()["status"] in ("counted", "stored")
    env.taskset.close()


def test_token_of_the_environment_is_sent(model, tmp_path, monkeypatch):
    database = tmp_path / "runs.sqlite3"
    create = [BINARY, "token", "create", "--db", database, "--role", "trainer", "trainer"]
    token = subprocess.run(create, check=True, capture_output=True, text=True).stdout.split()[-1]
    monkeypatch.setenv("SPARRING_TOKEN", token)
    with local_curriculum(settings=SETTINGS, db=database) as curriculum:
        env = sparring_verifiers.load_environment(curriculum.url, run=curriculum.run, group_size=2)
        # The third rollout runs a group that the server leased, which belongs to the server.
        (group,) = roll_out(env, model, list(env.taskset.take(1)), 3)
        assert [trace.reward for trace in group] == [stored(curriculum, trace)["score"] for trace in group]
        monkeypatch.setenv("SPARRING_TOKEN", "wrong")
        env = sparring_verifiers.load_environment(curriculum.url, run=curriculum.run)
        with pytest.raises(sparring.ApiError, match="401"):
            next(iter(env.taskset))
        with pytest.raises(sparring_verifiers.SessionError, match="token"):
            Session(curriculum.url, {"task": "survival", "seed": 1}, max_wait_s=60.0)


def test_skill_and_measured_groups_are_rewards(model):
    with local_curriculum(settings={**SETTINGS, "strategy": "plr_robust"}) as curriculum:
        env = sparring_verifiers.load_environment(curriculum.url, run=curriculum.run, reward="skill")
        (group,) = roll_out(env, model, list(env.taskset.take(1)), 4)
        assert [trace.info["sparring"]["train"] for trace in group] == [False] * 4
        assert [trace.reward for trace in group] == [0.0] * 4
        assert all(trace.metrics["score"] > 0 for trace in group)
        env.taskset.close()
    with local_curriculum() as curriculum:
        settings = {**SETTINGS, "contested_share": 1.0}
        env = sparring_verifiers.load_environment(
            curriculum.url, task="survival", settings={k: v for k, v in settings.items() if k != "tasks"}, reward="skill"
        )
        (group,) = roll_out(env, model, list(env.taskset.take(1)), 4)
        assert [trace.reward for trace in group] == [stored(curriculum, trace)["skill"] or 0.0 for trace in group]
        assert any(trace.reward for trace in group)
        env.taskset.close()


def test_lost_rollouts_are_failed_and_never_low_scores(curriculum):
    counts = curriculum.mastery()[0]["results"]
    chat = ChatServer(PLANS)
    chat.status = 500
    with chat.serving() as chat.address:
        env = sparring_verifiers.load_environment(curriculum.url, run=curriculum.run)
        (group,) = roll_out(env, chat, list(env.taskset.take(1)), 4)
    assert [trace.last_error.type for trace in group] == ["ProviderError"] * 4
    assert not any(trace.ok or trace.rewards.get("score") for trace in group)
    episodes = [stored(curriculum, trace) for trace in group]
    assert [episode["state"] for episode in episodes] == ["failed"] * 4
    assert all("broken" in episode["reason"] for episode in episodes)
    after = curriculum.mastery()[0]["results"]
    assert (after["episodes"], after["failed"]) == (counts["episodes"], counts["failed"] + 4)
    env.taskset.close()


def test_cancelled_rollouts_are_failed(curriculum):
    env = sparring_verifiers.load_environment(curriculum.url, run=curriculum.run)
    tasks = list(env.taskset.take(1))

    chat = ChatServer(PLANS, on_request=lambda: time.sleep(3.0))
    failed = curriculum.mastery()[0]["results"]["failed"]
    with chat.serving() as chat.address, pytest.raises(TimeoutError):
        roll_out(env, chat, tasks, 4, timeout=2.0)
    wait_until(lambda: curriculum.mastery()[0]["results"]["failed"] == failed + 4)
    env.taskset.close()


def test_end_of_the_server_is_an_error(model):
    curriculum = local_curriculum(settings=SETTINGS)
    chat = ChatServer([[[FIRE], [FIRE]]], on_request=lambda: len(chat.requests) == 2 and kill_server(curriculum))
    with chat.serving() as chat.address:
        env = sparring_verifiers.load_environment(curriculum.url, run=curriculum.run, max_wait_s=1.0)
        (group,) = roll_out(env, chat, list(env.taskset.take(1)), 1)
    assert group[0].last_error.type == "HarnessError" and "no server answers" in group[0].last_error.message
    assert not group[0].ok and group[0].reward == 0.0


def test_evaluation_has_the_means_of_the_rewards(curriculum, model):
    env = sparring_verifiers.load_environment(curriculum.url, suite="kessler-heldout-v1", task="survival", policy="scripted")
    assert env.taskset.bounded
    tasks = list(env.taskset)
    traces = flat(roll_out(env, model, tasks, 1))
    assert all(trace.ok for trace in traces) and {task.key for task in tasks} == {t.info["sparring"]["scenario"] for t in traces}
    (evaluation,) = {trace.info["sparring"]["evaluation"] for trace in traces}
    wait_until(lambda: curriculum.request("GET", f"/v1/evaluations/{evaluation}")["state"] == "complete")
    result = curriculum.request("GET", f"/v1/evaluations/{evaluation}")
    assert result["scenarios"] == len(tasks) == len(traces) and result["retries"] == 0
    rows = {row["part"]: row for row in result["rows"] if row["policy"] == "scripted" and row["task"] == "kessler/survival"}
    for part in ("contested", "as_they_come", "all"):
        chosen = [trace for trace in traces if part in ("all", trace.info["sparring"]["part"])]
        for name in ("score", "success", "skill", "fuel_used"):
            numbers = [trace.metrics[name] for trace in chosen if name in trace.metrics]
            assert rows[part][name]["mean"] == pytest.approx(sum(numbers) / len(numbers), abs=1e-12), (part, name)
        assert rows[part]["score"]["mean"] == pytest.approx(sum(t.reward for t in chosen) / len(chosen), abs=1e-12)
    # A row of a complete evaluation has no episode left.
    (again,) = roll_out(env, model, tasks[:1], 1)
    assert "`rollouts`" in again[0].last_error.message
    env.taskset.close()
    assert curriculum.request("GET", f"/v1/evaluations/{evaluation}")["state"] == "complete"


def test_printed_evaluation_runs(curriculum, model, capsys):
    (code,) = code_blocks("docs/guides/train-verifiers.md")
    names = {}
    exec(replace_all(code, {URL: curriculum.url, "http://127.0.0.1:8000/v1": model.address}), names)
    evaluation, mean = capsys.readouterr().out.split()
    wait_until(lambda: curriculum.request("GET", f"/v1/evaluations/{evaluation}")["state"] == "complete")
    rows = curriculum.request("GET", f"/v1/evaluations/{evaluation}")["rows"]
    stored_mean = next(row["score"]["mean"] for row in rows if (row["part"], row["policy"]) == ("all", "verifiers"))
    assert len(names["traces"]) == 192 and float(mean) == pytest.approx(stored_mean, abs=1e-12)


def test_incomplete_evaluation_is_cancelled(curriculum, model):
    env = sparring_verifiers.load_environment(curriculum.url, suite="kessler-heldout-v2", task="formation", rollouts=2)
    (group,) = roll_out(env, model, list(env.taskset.take(1)), 2)
    evaluation = group[0].info["sparring"]["evaluation"]
    path = f"/v1/evaluations/{evaluation}"
    assert all(trace.ok for trace in group) and curriculum.request("GET", path)["scenarios_done"] == 1
    env.taskset.close()
    result = curriculum.request("GET", path)
    assert result["state"] == "failed" and result["scenarios_done"] == 1


def test_failed_rollout_of_an_evaluation_can_run_again(curriculum, model):
    env = sparring_verifiers.load_environment(curriculum.url, suite="kessler-heldout-v1", task="survival")
    tasks = list(env.taskset.take(1))
    chat = ChatServer(PLANS)
    chat.status = 500
    with chat.serving() as chat.address:
        ((lost,),) = roll_out(env, chat, tasks, 1)
    ((found,),) = roll_out(env, model, tasks, 1)
    assert not lost.ok and found.ok
    assert lost.info["sparring"]["episode"] == found.info["sparring"]["episode"]
    env.taskset.close()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"run": "a", "suite": "kessler-heldout-v2"}, "`run` must be omitted with `suite`, got 'a' and 'kessler-heldout-v2'"),
        ({"run": "a", "task": "survival"}, "`tasks` must be omitted with `run`"),
        ({"run": "a", "settings": {"seed": 1}}, "`settings` must be omitted with `run`"),
        ({"task": "walking"}, "`task` must be one of kessler/survival"),
        ({"task": "docking/single"}, "`tasks` must be tasks of kessler, got docking/single"),
        ({"group_size": 0}, "`group_size`"),
        ({"reward": "luck"}, "`reward`"),
        ({"colour": "red"}, "`colour`"),
        ({"suite": "none"}, "`suite` must be one of kessler-heldout-v2"),
        ({"suite": "docking-heldout-v1"}, "`suite` must have tasks of kessler"),
        ({"suite": "kessler-heldout-v1", "task": "formation"}, "`tasks` must be one of"),
        ({"run": "none"}, "`run` must be the id of a run"),
        ({"settings": {"group_size": 0}}, "group_size"),
    ],
)
def test_invalid_argument_is_named(curriculum, arguments, message):
    with pytest.raises((ValueError, sparring.ApiError)) as error:
        list(sparring_verifiers.load_environment(curriculum.url, **arguments).taskset.take(1))
    assert message in str(error.value) and "\n" not in str(error.value)


def test_run_of_docking_is_rejected():
    with local_curriculum(settings={"tasks": ["docking/single"]}) as curriculum:
        env = sparring_verifiers.load_environment(curriculum.url, run=curriculum.run)
        with pytest.raises(ValueError, match="`run` must be a run with tasks of kessler only"):
            next(iter(env.taskset))


def test_unreachable_server_is_named():
    env = sparring_verifiers.load_environment("http://127.0.0.1:1", task="survival")
    with pytest.raises(sparring.ServerUnreachableError, match=r"no server answers at http://127\.0\.0\.1:1: .* `sparring serve`"):
        next(iter(env.taskset))


def test_harness_without_the_tools_is_rejected(curriculum, model):
    env = sparring_verifiers.load_environment(curriculum.url, run=curriculum.run, agent={"harness": {"id": "null"}})
    ((trace,),) = roll_out(env, model, list(env.taskset.take(1)), 1)
    assert "`env.agent.harness.id` must be 'sparring-verifiers'" in trace.last_error.message
    env.taskset.close()
