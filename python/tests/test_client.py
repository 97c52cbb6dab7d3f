"""Clients against a real server: all operations exist, and requests survive a restart of the server."""

import asyncio
import json
import pathlib
import signal
import threading
import time
import urllib.request

import pytest
from conftest import BINARY, needs_server
from curriculum_servers import SETTINGS, restarted_server, wait_until

import sparring
from sparring.server import Server

pytestmark = needs_server


@pytest.fixture(scope="module")
def url():
    server = Server(None, BINARY)
    yield server.url
    server.stop()


def test_client_runs_a_whole_training(url):
    with sparring.Client(url) as client:
        run = client.runs.create(**SETTINGS, name="by hand")["id"]
        assert client.runs.get(run)["name"] == "by hand"
        lease = client.leases.create(run, groups=2, ttl_s=60)
        results = []
        for group in lease["groups"]:
            scenario = sparring.Scenario.from_dict({**lease["recipes"][group["recipe"]], "seed": group["seed"]})
            _, actions = sparring.rollout(scenario, "heuristic")
            steps = [[[agent, *map(float, values)] for agent, values in enumerate(step)] for step in actions]
            results += [{"episode": name, "actions": {"steps": steps}} for name in group["episodes"]]
        for expected in ("counted", "duplicate"):
            reported = client.results.report(run, results=results)["results"]
            assert {result["status"] for result in reported} == {expected}, reported
        assert client.mastery.get(run)["tasks"][0]["results"]["episodes"] == 2
        assert [episode["episode"] for episode in client.paginate(client.episodes.list, run, limit=1)]
        assert client.runs.pause(run)["status"] == "paused"
        with pytest.raises(sparring.ApiError) as error:
            client.leases.create(run, groups=1)
        assert error.value.status == 409
        assert client.runs.archive(run)["archived_at"]
        kinds = []
        for event in client.events(run, after=0):
            kinds.append((event.kind, event.data.get("state")))
            if kinds[-1] == ("run", "archived"):
                break
        assert kinds[0] == ("run", "created")


def test_rejected_request_names_the_field(url):
    with sparring.Client(url) as client:
        with pytest.raises(sparring.ApiError, match=r"422: tasks\.0") as error:
            client.runs.create(tasks=["none"])
        assert error.value.field == "tasks.0"
        with pytest.raises(sparring.ApiError, match="400: run"):
            client.runs.get("../audit")
        with pytest.raises(ValueError, match="JSON"):
            client.runs.create(contested_share=float("nan"))
        with pytest.raises(ValueError, match="lists"):
            list(client.paginate(client.mastery.list_level_moves, client.runs.create(**SETTINGS)["id"]))


def test_async_client_has_the_same_operations(url):
    async def run_requests():
        async with sparring.AsyncClient(url) as client:
            runs = await asyncio.gather(*(client.runs.create(**SETTINGS, name=f"run {n}") for n in range(5)))
            names = [run["name"] async for run in client.paginate(client.runs.list, limit=2)]
            assert {f"run {n}" for n in range(5)} <= set(names)
            with pytest.raises(sparring.ApiError, match="404"):
                await client.runs.get("run-none")
            await client.runs.archive(runs[0]["id"])
            states = []
            async for event in client.events(runs[0]["id"], after=0):
                states.append(event.data.get("state"))
                if states[-1] == "archived":
                    return states

    assert asyncio.run(run_requests())[0] == "created"


def test_requests_and_events_survive_a_restart(tmp_path):
    db = tmp_path / "run.sqlite3"
    server = Server(db, BINARY)
    with sparring.Client(server.url, retry_timeout_s=30) as client:
        run = client.runs.create(**SETTINGS)["id"]
        events = client.events(run, after=0)
        assert next(events).data["state"] == "created"
        server._process.send_signal(signal.SIGKILL)
        server._process.wait()
        with restarted_server(db, server.url, 1.0):
            assert client.runs.get(run)["id"] == run
            client.runs.archive(run)
            assert any(event.data.get("state") == "archived" for event in events)
        with sparring.Client(server.url, retry_timeout_s=0.5) as impatient, pytest.raises(sparring.ServerUnreachableError):
            impatient.runs.list()


def count_event_streams(url):
    """Returns the number of event streams that a server has opened."""
    with urllib.request.urlopen(f"{url}/metrics", timeout=60) as response:
        lines = response.read().decode().splitlines()
    requests = [line for line in lines if line.startswith("sparring_http_requests_total") and "/events" in line]
    return sum(int(line.rsplit(" ", 1)[1]) for line in requests)


def test_listener_without_events_misses_none_in_a_restart(tmp_path):
    db = tmp_path / "run.sqlite3"
    server = Server(db, BINARY)
    with sparring.Client(server.url) as client:
        run = client.runs.create(**SETTINGS)["id"]
        states = []

        def listen():
            with sparring.Client(server.url) as other:
                states.extend(event.data["state"] for _, event in zip(range(2), other.events(run), strict=False))

        listener = threading.Thread(target=listen)
        listener.start()
        wait_until(lambda: count_event_streams(server.url) == 1)
        server._process.terminate()
        server._process.wait()
        with restarted_server(db, server.url):
            # Both events happen before the listener has reconnected.
            client.runs.pause(run)
            client.runs.resume(run)
            listener.join(120)
            assert states == ["paused", "resumed"]


@pytest.mark.parametrize("is_async", [False, True])
def test_idle_listener_survives_a_restart(tmp_path, is_async):
    db = tmp_path / "run.sqlite3"
    server = Server(db, BINARY)
    states = []

    def listen(run):
        with sparring.Client(server.url, retry_timeout_s=5) as client:
            states.extend(event.data["state"] for _, event in zip(range(2), client.events(run, after=0), strict=False))

    async def listen_async(run):
        async with sparring.AsyncClient(server.url, retry_timeout_s=5) as client:
            async for event in client.events(run, after=0):
                states.append(event.data["state"])
                if len(states) == 2:
                    return

    with sparring.Client(server.url, retry_timeout_s=30) as client:
        run = client.runs.create(**SETTINGS)["id"]
        listener = threading.Thread(target=(lambda: asyncio.run(listen_async(run))) if is_async else lambda: listen(run))
        listener.start()
        wait_until(lambda: states == ["created"])
        time.sleep(6)  # tests the passing of time: the listener is idle for longer than retry_timeout_s
        server._process.terminate()
        server._process.wait()
        with restarted_server(db, server.url):
            client.runs.pause(run)
            listener.join(120)
            assert states == ["created", "paused"]


def test_every_operation_of_v1_has_a_method():
    snapshot = pathlib.Path(__file__).parents[2] / "tests/tests/system/snapshots/system__documents__openapi.snap"
    document = json.loads(snapshot.read_text().split("\n---\n", 1)[1])
    streams = {"/v1/sessions", "/v1/runs/{run}/sessions", "/v1/runs/{run}/events"}  # sockets, and `events`
    count = sum(
        len(verbs)
        for path, verbs in document["paths"].items() if path.startswith("/v1/") and path not in streams
    )  # fmt: skip
    client = sparring.Client("http://127.0.0.1:1")
    groups = [group for name, group in vars(client).items() if not name.startswith("_")]
    methods = [name for group in groups for name in dir(type(group)) if not name.startswith("_")]
    assert len(methods) == count > 50
    client.close()


@pytest.mark.parametrize("url", ["127.0.0.1:8700", "ftp://127.0.0.1", "http://", "http://[::1", None])
def test_invalid_url_is_rejected(url):
    with pytest.raises(ValueError, match=r"^`url` must "):
        sparring.Client(url)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("timeout_s", 0),
        ("timeout_s", -1),
        ("timeout_s", "5"),
        ("retry_timeout_s", float("nan")),
        ("retry_timeout_s", -1),
        ("retry_timeout_s", True),
    ],
)
def test_invalid_timeout_is_rejected(field, value):
    for make in (sparring.Client, sparring.AsyncClient):
        with pytest.raises(ValueError, match=f"^`{field}` must "):
            make("http://127.0.0.1:1", **{field: value})


@pytest.fixture
def fake_server():
    """Server that returns the responses of a test, one after another, and counts requests."""
    from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self):
            server = self.server
            self.rfile.read(int(self.headers.get("Content-Length", 0)))
            server.requests += 1
            status, headers, body = server.responses[min(server.requests, len(server.responses)) - 1]
            self.send_response(status)
            for name, value in {"Content-Length": str(len(body)), **headers}.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(body)

        do_GET = do_POST

        def log_message(self, *_):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.requests, server.url = 0, f"http://127.0.0.1:{server.server_address[1]}"
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server
    server.shutdown()
    server.server_close()


def problem(kind):
    return json.dumps({"type": f"urn:sparring:problem:{kind}", "detail": f"it is {kind}"}).encode()


@pytest.mark.parametrize(
    ("kind", "requests"), [("busy", 2), ("not_ready", 2), ("unavailable", 2), ("timed_out", 1), ("", 1)], ids=str
)
def test_possibly_executed_request_is_not_repeated(fake_server, kind, requests):
    headers = {"Retry-After": "0"}
    fake_server.responses = [(503, headers, problem(kind) if kind else b"<html>"), (200, {}, b'{"id": "made"}')]
    with sparring.Client(fake_server.url) as client:
        if requests == 2:
            assert client.runs.create(tasks=["kessler/survival"])["id"] == "made"
        else:
            with pytest.raises(sparring.ApiError, match="503"):
                client.runs.create(tasks=["kessler/survival"])
        assert fake_server.requests == requests
        fake_server.requests = 0
        assert client.runs.list() == {"id": "made"}, "a GET is always repeated"
    fake_server.requests = 0
    client = sparring._native.NativeHttpClient(fake_server.url)
    if requests == 2:
        assert json.loads(client.request("POST", "/v1/runs", "{}")) == {"id": "made"}
    else:
        with pytest.raises(sparring.CurriculumError, match="POST /v1/runs: 503"):
            client.request("POST", "/v1/runs", "{}")
    assert fake_server.requests == requests


def test_keep_alive_comment_is_not_an_event(fake_server):
    message = b'id: %d\nevent: run\ndata: {"state": "paused"}\n\n'
    fake_server.responses = [(200, {"Content-Type": "text/event-stream"}, message % 1 + b":\n\n: comment\n\n" + message % 2)]
    with sparring.Client(fake_server.url) as client:
        ids = [event.id for _, event in zip(range(2), client.events("mine"), strict=False)]
    assert ids == [1, 2]

    async def listen():
        async with sparring.AsyncClient(fake_server.url) as client:
            ids = []
            async for event in client.events("mine"):
                ids.append(event.id)
                if len(ids) == 2:
                    return ids

    assert asyncio.run(listen()) == [1, 2]


@pytest.mark.parametrize("after", ["", "18446744073709551615", "99999999999999999999999", "soon"])
def test_error_response_is_raised_at_once(fake_server, after):
    fake_server.responses = [(500, {"Retry-After": after}, problem("internal"))]
    with pytest.raises(sparring.CurriculumError, match="GET /v1/runs: 500: it is internal"):
        sparring._native.NativeHttpClient(fake_server.url).request("GET", "/v1/runs")


def test_server_of_another_version_is_named(fake_server):
    fake_server.responses = [(200, {"sparring-version": "99.1.0"}, b"{}")]
    sentence = "the server has version 99.1.0 and this client .*; install the same version of both"
    with sparring.Client(fake_server.url) as client, pytest.raises(sparring.ApiError, match=sentence):
        client.runs.list()
    with pytest.raises(sparring.CurriculumError, match=sentence):
        sparring.Curriculum(fake_server.url, run="any")
