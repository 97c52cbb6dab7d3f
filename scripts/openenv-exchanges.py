"""Records exchanges with the server of openenv 0.10: openenv-exchanges.py FILE

The exchanges are a list of steps, in the order in which they are repeated. A step either sends a request over HTTP, connects a
WebSocket, sends a text on one, receives a frame, or closes one. `{session}` and `{split}` stand for values of earlier responses.
"""
import contextlib, importlib.metadata, json, socket, sys, threading, time, urllib.error, urllib.request

import uvicorn
from openenv.core.env_server.http_server import create_fastapi_app
from openenv.core.env_server.interfaces import Environment
from openenv.core.env_server.types import Action, Observation, State
from pydantic import BaseModel, Field
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

PACKAGES = ("openenv", "fastapi", "starlette", "pydantic", "uvicorn")
TASKS = 5


class Burn(BaseModel):
    satellite_id: int
    delta_vx: float
    delta_vy: float


class BurnAction(Action):
    burns: list[Burn] = Field(default_factory=list)


class IdleObservation(Observation):
    total_score: float = 0.0


class IdleEnvironment(Environment):
    """Environment in which nothing moves, with one split of tasks."""

    SUPPORTS_CONCURRENT_SESSIONS = True

    def __init__(self):
        super().__init__()
        self._state = State(episode_id="idle", step_count=0)

    def reset(self, seed=None, episode_id=None, **_):
        self._state = State(episode_id=episode_id or "idle", step_count=0)
        return IdleObservation(reward=0.0, metadata={"task": "idle"})

    def step(self, action, timeout_s=None, **_):
        self._state.step_count += 1
        return IdleObservation(reward=0.5)

    @property
    def state(self):
        return self._state

    def list_splits(self):
        return ["test"]

    def num_tasks(self, split):
        return TASKS

    def get_task(self, split, index):
        if not 0 <= index < TASKS:
            raise IndexError(index)
        return {"id": f"{split}-{index}", "index": index}

    def list_tasks(self, split):
        return [self.get_task(split, index) for index in range(TASKS)]

    def get_task_range(self, split, start=None, stop=None):
        return [self.get_task(split, index) for index in range(start or 0, TASKS if stop is None else stop)]


def rpc(method, **params):
    return {"jsonrpc": "2.0", "id": 1, "method": method, "params": params}


def post(path, body):
    return {"do": "post", "path": path, "body": body}


def get(path):
    return {"do": "get", "path": path}


def attach(name, session):
    return {"do": "connect", "socket": name, "path": f"/ws?session_id={session}"}


def send(name, message):
    return {"do": "send", "socket": name, "text": json.dumps(message)}


def receive(name):
    return {"do": "receive", "socket": name}


STEPS = [
    post("/mcp", rpc("openenv/session/create")) | {"save": ["session", "/result/session_id"]},
    attach("first", "{session}"),
    send("first", {"type": "reset", "data": {"seed": 1}}), receive("first"),
    send("first", {"type": "step", "data": {"burns": []}}), receive("first"),
    send("first", {"type": "state"}), receive("first"),
    send("first", {"type": "step", "data": {"burns": [{"satellite_id": 0, "delta_vx": 0.1}]}}), receive("first"),
    attach("second", "{session}"), receive("second"), receive("second"),
    attach("unknown", "no-such-session"), receive("unknown"), receive("unknown"),
    {"do": "close", "socket": "first"},
    attach("third", "{session}"),
    send("third", {"type": "state"}), receive("third"),
    post("/mcp", rpc("openenv/session/close", session_id="{session}")),
    send("third", {"type": "close"}), receive("third"),
    {"do": "wait", "seconds": 0.5},
    post("/mcp", rpc("tools/list", session_id="{session}")),
    attach("late", "{session}"), receive("late"),
    post("/mcp", rpc("openenv/session/create")) | {"save": ["session", "/result/session_id"]},
    post("/mcp", rpc("openenv/session/close", session_id="{session}")),
    post("/mcp", rpc("openenv/session/close", session_id="{session}")),
    post("/mcp", rpc("openenv/session/close")),
    get("/list_environments") | {"save": ["environment", "/0"]},
    get("/{environment}/splits") | {"save": ["split", "/0/name"]},
    post("/{environment}/num_tasks", {"split": "{split}"}),
    post("/{environment}/tasks", {"split": "{split}"}),
    post("/{environment}/task", {"split": "{split}", "index": 3}),
    post("/{environment}/task", {"split": "{split}", "index": 1000000}),
    post("/{environment}/task", {"split": "{split}", "index": "x"}),
    post("/{environment}/task", {"split": "{split}"}),
    post("/{environment}/task", {"split": "{split}", "index": 1, "more": 1}),
    post("/{environment}/task_range", {"split": "{split}", "start": 1, "stop": 3}),
    post("/{environment}/task_range", {"split": "{split}", "start": 1, "stop": 1000000}),
    post("/{environment}/tasks", {}),
    get("/schema"),
]


class Recorder:
    def __init__(self, url):
        self.url, self.sockets, self.saved = url, {}, {}
        self.stack = contextlib.ExitStack()

    def fill(self, text):
        for name, value in self.saved.items():
            text = text.replace("{" + name + "}", value)
        return text

    def request(self, method, path, body):
        data = None if body is None else self.fill(json.dumps(body)).encode()
        request = urllib.request.Request(self.url + self.fill(path), data, {"content-type": "application/json"}, method=method)
        try:
            answer = urllib.request.urlopen(request)
        except urllib.error.HTTPError as error:
            answer = error
        with answer:
            return {"status": answer.status, "json": json.load(answer)}

    def run(self, step):
        """Runs a step and returns it with its response."""
        if step["do"] in ("post", "get"):
            response = self.request(step["do"].upper(), step["path"], step.get("body"))
            if "save" in step:
                name, pointer = step["save"]
                value = response["json"]
                for part in pointer.split("/")[1:]:
                    value = value[int(part)] if isinstance(value, list) else value[part]
                self.saved[name] = value
            return {**step, "response": self.hide(response)}
        if step["do"] == "connect":
            connection = connect(self.url.replace("http", "ws") + self.fill(step["path"]))
            self.sockets[step["socket"]] = self.stack.enter_context(connection)
        elif step["do"] == "send":
            self.sockets[step["socket"]].send(step["text"])
        elif step["do"] == "close":
            self.sockets[step["socket"]].close()
        elif step["do"] == "wait":
            time.sleep(step["seconds"])
        else:
            try:
                return {**step, "response": self.hide({"json": json.loads(self.sockets[step["socket"]].recv(timeout=10))})}
            except ConnectionClosed as error:
                return {**step, "response": {"closed": error.rcvd.code}}
        return step

    def hide(self, response):
        """Replaces the random ids in a response by their names."""
        text = json.dumps(response)
        if session := self.saved.get("session"):
            text = text.replace(session, "{session}")
        return json.loads(text)


def main():
    listener = socket.create_server(("127.0.0.1", 0))
    app = create_fastapi_app(IdleEnvironment, BurnAction, IdleObservation, max_concurrent_envs=8, env_name="idle")
    server = uvicorn.Server(uvicorn.Config(app, log_level="warning"))
    threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True).start()
    while not server.started:
        time.sleep(0.05)
    recorder = Recorder(f"http://127.0.0.1:{listener.getsockname()[1]}")
    with recorder.stack:
        steps = [recorder.run(step) for step in STEPS]
    packages = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in PACKAGES)
    with open(sys.argv[1], "w", encoding="utf-8") as out:
        json.dump({"server": packages, "steps": steps}, out, indent=1)
        out.write("\n")
    print(f"{len(steps)} steps with {packages}")


main()
