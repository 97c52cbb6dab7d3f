"""Runs the clients of openenv 0.10 against a server: openenv_0_10_clients.py URL

Prints one line for each check and fails at the first difference.
"""
import asyncio, json, pathlib, shutil, subprocess, sys, tempfile, urllib.error, urllib.request

from openenv.core.generic_client import GenericEnvClient
from openenv.core.mcp_client import MCPToolClient
from server_metrics import read_gauge
from websockets.sync.client import connect

URL = sys.argv[1]
ROOT = pathlib.Path(__file__).parents[2]
BURN = {"burns": [{"satellite_id": 0, "delta_vx": 0.01, "delta_vy": 0.0}]}


def send(method, path, body=None):
    """Sends a request; returns the status with the body of the response."""
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(URL + path, data, {"content-type": "application/json"}, method=method)
    try:
        with urllib.request.urlopen(request) as response:
            return response.status, json.load(response)
    except urllib.error.HTTPError as error:
        return error.code, json.load(error)


async def share_one_session():
    """The WebSocket of MCPToolClient attaches to the session of its HTTP requests."""
    async with MCPToolClient(base_url=URL, mode="production") as env:
        result = await env.reset(task="rendezvous", seed=5)
        assert result.metadata["task"] == "kessler/rendezvous", result.metadata
        names = [tool.name for tool in await env.list_tools()]
        assert names == ["fire_thrusters", "hold", "telemetry", "conjunctions"], names
        seen = await env.call_tool("telemetry")
        assert seen["observation"]["mission_objective"].startswith("RENDEZVOUS"), seen
        assert seen["step"] == 0, seen
        called = await env.call_tool("fire_thrusters", **BURN)
        assert called["step"] == 1, called
        state = await env.state()
        assert state.step_count == 1, state
        active = read_gauge(URL, "sparring_sessions")
        assert active == 1, f"one session takes one place, got {active}"
        session = env._production_session_id
        refusal = frame_of_attachment(session)
        assert refusal["data"]["message"] == f"Session {session} already has an attached WebSocket", refusal
    assert read_gauge(URL, "sparring_sessions") == 0, "the closed client frees its place"
    unknown = frame_of_attachment("no-such-session")
    assert unknown == {"type": "error", "data": {"message": "Unknown session_id: no-such-session", "code": "SESSION_ERROR"}}, unknown
    print("MCPToolClient: resets and tools share one session, which takes one place")


def frame_of_attachment(session):
    """Returns the frame that refuses a WebSocket with this session, which the server then closes."""
    with connect(URL.replace("http", "ws") + f"/ws?session_id={session}") as socket:
        return json.loads(socket.recv(timeout=10))


def close_while_attached():
    """A session that is closed while a WebSocket is attached ends with the WebSocket."""
    rpc = lambda method, params: send("POST", "/mcp", {"jsonrpc": "2.0", "id": 1, "method": method, "params": params})[1]
    session = rpc("openenv/session/create", {"task": "survival", "seed": 1})["result"]["session_id"]
    with connect(URL.replace("http", "ws") + f"/ws?session_id={session}") as socket:
        socket.send(json.dumps({"type": "state"}))
        assert json.loads(socket.recv(timeout=10))["data"]["task"] == "kessler/survival"
        closed = rpc("openenv/session/close", {"session_id": session})["result"]
        assert closed == {"session_id": session, "closed": False, "closing": True}, closed
    for _ in range(100):
        answer = rpc("tools/call", {"name": "telemetry", "session_id": session})
        if "error" in answer:
            break
    assert answer["error"]["message"] == f"Unknown session_id: {session}", answer
    # Without a closing request, the session outlives the WebSocket.
    session = rpc("openenv/session/create", {})["result"]["session_id"]
    for task in ("docking/single", "survival"):
        with connect(URL.replace("http", "ws") + f"/ws?session_id={session}") as socket:
            socket.send(json.dumps({"type": "reset", "data": {"task": task, "seed": 1}}))
            assert json.loads(socket.recv(timeout=10))["type"] == "observation"
            socket.send(json.dumps({"type": "close"}))
    assert rpc("openenv/session/close", {"session_id": session})["result"]["closed"] is True
    print("sessions: an attached WebSocket leaves the session open, or ends one that is closing")


async def run_new_sessions():
    async with GenericEnvClient(base_url=URL) as env:
        first = await env.reset(seed=7, task="survival")
        child = await env.new_session()
        second = await child.reset(seed=7, task="survival")
        assert first.observation == second.observation
        await child.step(BURN)
        assert (await env.state())["step_count"] == 0
        try:
            await env.step({"burns": [{"satellite_id": 0, "delta_vx": "fast"}]})
        except RuntimeError as error:
            assert "burns.0.delta_vx" in str(error), error
        else:
            raise AssertionError("a bad action must fail")
        try:
            await env.reset(run_id="some-run")
        except RuntimeError as error:
            assert "run_id: Value error, must be sent as `run`" in str(error), error
        else:
            raise AssertionError("run_id must be refused")
        while not (result := await env.step(BURN)).done:
            assert result.metadata is None, result.metadata
        assert result.metadata["step_count"] > 0, result.metadata
    print("GenericEnvClient: new_session, metadata, and errors that name their field")


async def discover_tasks():
    assert send("GET", "/list_environments") == (200, ["sparring"])
    splits = send("GET", "/sparring/splits")[1]
    split = splits[0]["name"]
    assert {"name": "docking-heldout-v1", "type": "test"} in splits, splits
    assert send("GET", "/other/splits")[0] == 404
    count = send("POST", "/sparring/num_tasks", {"split": split})[1]["num_tasks"]
    listed = send("POST", "/sparring/tasks", {"split": split})[1]
    assert listed["env_name"] == "sparring" and len(listed["tasks"]) == count > 100
    assert [task["index"] for task in listed["tasks"]] == list(range(count))
    some = send("POST", "/sparring/task_range", {"split": split, "start": 3, "stop": 6})[1]["tasks"]
    assert some == listed["tasks"][3:6], some
    assert send("POST", "/sparring/task", {"split": split, "index": 3})[1]["task"] == some[0]
    assert send("POST", "/sparring/task", {"split": split, "index": count}) == (400, {"detail": "Invalid task index"})
    assert send("POST", "/sparring/task_range", {"split": split, "start": 9, "stop": 6})[0] == 400
    assert send("POST", "/sparring/tasks", {"split": "train"})[0] == 404
    missing = send("POST", "/sparring/task", {"split": split})
    assert missing[0] == 422 and missing[1]["detail"][0]["loc"] == ["body", "index"], missing
    async with GenericEnvClient(base_url=URL) as env:
        result = await env.reset(split=split, index=3)
        assert result.metadata["scenario_id"] == some[0]["id"], result.metadata
        assert result.metadata["task"] == some[0]["task"], result.metadata
        for wrong, field in [({"index": count}, "index"), ({"index": 3, "seed": 1}, "seed"), ({}, "index")]:
            try:
                await env.reset(split=split, **wrong)
            except RuntimeError as error:
                assert f"Invalid message: {field}: Value error" in str(error), error
            else:
                raise AssertionError(f"{wrong} must be refused")
    print(f"tasks: {count} scenarios of {split} are listed, and begin by split and index")


def validate():
    schema = send("GET", "/schema")[1]
    assert schema["reset_observation"] == schema["observation"]
    openenv = [sys.executable, "-m", "openenv.cli", "validate"]
    package = tempfile.mkdtemp()
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True)
    # Without a checkout, the files that the validator reads.
    names = listed.stdout.split("\0") if listed.returncode == 0 else ["openenv.yaml", "Dockerfile", "README.md"]
    for name in filter(None, names):
        if (ROOT / name).exists():
            (pathlib.Path(package) / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, pathlib.Path(package) / name)
    for arguments, passed in [
        (["--url", URL, "--json"], '"passed": true'),
        ([package, "--level", "static", "--skip-build", "--json"], '"verdict": "pass"'),
    ]:
        report = subprocess.run([*openenv, *arguments], capture_output=True, text=True)
        assert report.returncode == 0 and passed in report.stdout, report.stdout + report.stderr
        assert "FAIL" not in report.stdout, report.stdout
    shutil.rmtree(package)
    print("openenv validate: the server and the package pass")


asyncio.run(share_one_session())
close_while_attached()
asyncio.run(run_new_sessions())
asyncio.run(discover_tasks())
validate()
