"""The clients against a real server: every operation is there, and a server that dies is waited for."""

import asyncio
import json
import pathlib
import signal
import threading
import time

import pytest
from conftest import BINARY, served
from flights import serve_again

import sparring
from sparring.server import Server

pytestmark = served
WISH = {"tasks": ["kessler/survival"], "placement": False, "design": {"designer": "off"}}


@pytest.fixture(scope="module")
def url():
    server = Server(None, BINARY)
    yield server.url
    server.stop()


def test_a_run_from_its_beginning_to_its_end(url):
    with sparring.Client(url) as client:
        run = client.runs.create(**WISH, name="by hand")["id"]
        assert client.runs.show(run)["name"] == "by hand"
        lease = client.leases.take(run, groups=2, ttl_s=60)
        results = []
        for group in lease["groups"]:
            scenario = sparring.Scenario.from_dict({**lease["recipes"][group["recipe"]], "seed": group["seed"]})
            _, flown = sparring.fly(scenario, "heuristic")
            steps = [[[agent, *map(float, acted)] for agent, acted in enumerate(step)] for step in flown]
            results += [{"episode": name, "actions": {"steps": steps}} for name in group["episodes"]]
        for expected in ("counted", "duplicate"):
            told = client.results.report(run, results=results)["results"]
            assert {result["status"] for result in told} == {expected}, told
        assert client.mastery.show(run)["tasks"][0]["plain"]["episodes"] == 2
        assert [episode["episode"] for episode in client.every(client.episodes.list, run, limit=1)]
        assert client.runs.pause(run)["status"] == "paused"
        with pytest.raises(sparring.ApiError) as refused:
            client.leases.take(run, groups=1)
        assert refused.value.status == 409
        assert client.runs.archive(run)["archived_at"]
        kinds = []
        for event in client.events(run, after=0):
            kinds.append((event.kind, event.data.get("state")))
            if kinds[-1] == ("run", "archived"):
                break
        assert kinds[0] == ("run", "created")


def test_what_is_refused_names_the_field(url):
    with sparring.Client(url) as client:
        with pytest.raises(sparring.ApiError, match=r"422: tasks\.0") as refused:
            client.runs.create(tasks=["none"])
        assert refused.value.field == "tasks.0"
        with pytest.raises(sparring.ApiError, match="400: run"):
            client.runs.show("../audit")
        with pytest.raises(ValueError, match="JSON"):
            client.runs.create(contested_share=float("nan"))
        with pytest.raises(ValueError, match="lists"):
            list(client.every(client.mastery.history, client.runs.create(**WISH)["id"]))


def test_the_same_to_be_awaited(url):
    async def fly():
        async with sparring.AsyncClient(url) as client:
            runs = await asyncio.gather(*(client.runs.create(**WISH, name=f"at once {n}") for n in range(5)))
            names = [run["name"] async for run in client.every(client.runs.list, limit=2)]
            assert {f"at once {n}" for n in range(5)} <= set(names)
            with pytest.raises(sparring.ApiError, match="404"):
                await client.runs.show("run-none")
            await client.runs.archive(runs[0]["id"])
            seen = []
            async for event in client.events(runs[0]["id"], after=0):
                seen.append(event.data.get("state"))
                if seen[-1] == "archived":
                    return seen

    assert asyncio.run(fly())[0] == "created"


def test_a_server_that_comes_back_is_waited_for(tmp_path):
    db = tmp_path / "run.sqlite3"
    server = Server(db, BINARY)
    with sparring.Client(server.url, patience_s=30) as client:
        run = client.runs.create(**WISH)["id"]
        heard = client.events(run, after=0)
        assert next(heard).data["state"] == "created"
        server._process.send_signal(signal.SIGKILL)
        server._process.wait()
        with serve_again(db, server.url, 1.0):
            assert client.runs.show(run)["id"] == run
            client.runs.archive(run)
            assert any(event.data.get("state") == "archived" for event in heard)
        with sparring.Client(server.url, patience_s=0.5) as hasty, pytest.raises(sparring.Unreachable):
            hasty.runs.list()


def test_who_has_heard_nothing_yet_misses_nothing_through_a_restart(tmp_path):
    db = tmp_path / "run.sqlite3"
    server = Server(db, BINARY)
    with sparring.Client(server.url) as client:
        run = client.runs.create(**WISH)["id"]
        heard = []

        def listen():
            with sparring.Client(server.url) as ears:
                heard.extend(event.data["state"] for _, event in zip(range(2), ears.events(run), strict=False))

        listener = threading.Thread(target=listen)
        listener.start()
        time.sleep(1)
        server._process.terminate()
        server._process.wait()
        with serve_again(db, server.url):
            # At once, before who listens is back.
            client.runs.pause(run)
            client.runs.resume(run)
            listener.join(20)
            assert heard == ["paused", "resumed"]


@pytest.mark.parametrize("awaited", [False, True])
def test_a_run_in_which_nothing_happens_is_listened_to_through_a_restart(tmp_path, awaited):
    db = tmp_path / "run.sqlite3"
    server = Server(db, BINARY)
    heard = []

    def listen(run):
        with sparring.Client(server.url, patience_s=2) as client:
            heard.extend(event.data["state"] for _, event in zip(range(2), client.events(run, after=0), strict=False))

    async def await_them(run):
        async with sparring.AsyncClient(server.url, patience_s=2) as client:
            async for event in client.events(run, after=0):
                heard.append(event.data["state"])
                if len(heard) == 2:
                    return

    with sparring.Client(server.url, patience_s=30) as client:
        run = client.runs.create(**WISH)["id"]
        listener = threading.Thread(target=(lambda: asyncio.run(await_them(run))) if awaited else lambda: listen(run))
        listener.start()
        time.sleep(3)  # longer than it has patience
        server._process.terminate()
        server._process.wait()
        with serve_again(db, server.url):
            client.runs.pause(run)
            listener.join(20)
            assert heard == ["created", "paused"]


def test_every_operation_of_v1_has_a_method():
    snapshot = pathlib.Path(__file__).parents[2] / "tests/tests/system/snapshots/system__documents__openapi.snap"
    document = json.loads(snapshot.read_text().split("\n---\n", 1)[1])
    elsewhere = {"connect", "listen"}  # a socket, and `events`
    count = sum(
        operation["operationId"] not in elsewhere
        for path, verbs in document["paths"].items() if path.startswith("/v1/")
        for operation in verbs.values()
    )  # fmt: skip
    client = sparring.Client("http://127.0.0.1:1")
    groups = [group for name, group in vars(client).items() if not name.startswith("_")]
    methods = [name for group in groups for name in dir(type(group)) if not name.startswith("_")]
    assert len(methods) == count > 50
    client.close()


@pytest.mark.parametrize("url", ["127.0.0.1:8700", "ftp://127.0.0.1", "http://", "http://[::1", None])
def test_a_url_that_is_none(url):
    with pytest.raises(ValueError, match=r"^url: "):
        sparring.Client(url)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("timeout_s", 0),
        ("timeout_s", -1),
        ("timeout_s", "5"),
        ("patience_s", float("nan")),
        ("patience_s", -1),
        ("patience_s", True),
    ],
)
def test_seconds_that_are_none(field, value):
    for made in (sparring.Client, sparring.AsyncClient):
        with pytest.raises(ValueError, match=f"^{field}: "):
            made("http://127.0.0.1:1", **{field: value})


@pytest.fixture
def broken():
    """A server that answers whatever it is asked by what a test says, and counts how often."""
    from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

    class Answers(BaseHTTPRequestHandler):
        def do_POST(self):
            told = self.server
            self.rfile.read(int(self.headers.get("Content-Length", 0)))
            told.asked += 1
            status, headers, body = told.answers[min(told.asked, len(told.answers)) - 1]
            self.send_response(status)
            for name, value in {"Content-Length": str(len(body)), **headers}.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(body)

        do_GET = do_POST

        def log_message(self, *_):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Answers)
    server.asked, server.url = 0, f"http://127.0.0.1:{server.server_address[1]}"
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server
    server.shutdown()
    server.server_close()


def problem(kind):
    return json.dumps({"type": f"urn:sparring:problem:{kind}", "detail": f"it is {kind}"}).encode()


@pytest.mark.parametrize(
    ("kind", "asked"), [("busy", 2), ("not_ready", 2), ("unavailable", 2), ("timed_out", 1), ("", 1)], ids=str
)
def test_what_may_have_been_done_is_not_done_twice(broken, kind, asked):
    again = {"Retry-After": "0"}
    broken.answers = [(503, again, problem(kind) if kind else b"<html>"), (200, {}, b'{"id": "made"}')]
    with sparring.Client(broken.url) as client:
        if asked == 2:
            assert client.runs.create(tasks=["kessler/survival"])["id"] == "made"
        else:
            with pytest.raises(sparring.ApiError, match="503"):
                client.runs.create(tasks=["kessler/survival"])
        assert broken.asked == asked
        broken.asked = 0
        assert client.runs.list() == {"id": "made"}, "looking is done as often as it takes"
    broken.asked = 0
    link = sparring._native.NativeLink(broken.url)
    if asked == 2:
        assert json.loads(link.ask("POST", "/v1/runs", "{}")) == {"id": "made"}
    else:
        with pytest.raises(sparring.CurriculumError, match="POST /v1/runs: 503"):
            link.ask("POST", "/v1/runs", "{}")
    assert broken.asked == asked


def test_what_keeps_a_stream_open_is_no_event(broken):
    told = b'id: %d\nevent: run\ndata: {"state": "paused"}\n\n'
    broken.answers = [(200, {"Content-Type": "text/event-stream"}, told % 1 + b":\n\n: here\n\n" + told % 2)]
    with sparring.Client(broken.url) as client:
        heard = [event.id for _, event in zip(range(2), client.events("mine"), strict=False)]
    assert heard == [1, 2]

    async def listen():
        async with sparring.AsyncClient(broken.url) as client:
            ids = []
            async for event in client.events("mine"):
                ids.append(event.id)
                if len(ids) == 2:
                    return ids

    assert asyncio.run(listen()) == [1, 2]


@pytest.mark.parametrize("after", ["", "18446744073709551615", "99999999999999999999999", "soon"])
def test_an_answer_that_is_an_error_is_no_silence(broken, after):
    broken.answers = [(500, {"Retry-After": after}, problem("internal"))]
    with pytest.raises(sparring.CurriculumError, match="GET /v1/runs: 500: it is internal"):
        sparring._native.NativeLink(broken.url).ask("GET", "/v1/runs")
