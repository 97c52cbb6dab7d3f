"""A trainer whose episodes run on the server, one environment over one WebSocket.

    pip install websockets
    sparring serve &
    python examples/step.py http://127.0.0.1:8700 4     # the number of episodes is optional (6)

The curriculum of a run chooses the scenarios. The server records the actions, and answers the last step of an episode once its
outcome is stored. docs/reference/stepping.md documents the messages.
"""

import contextlib
import json
import os
import sys
import time
import urllib.request

from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import connect

# Authorization header, if the server has tokens.
TOKEN = {"Authorization": f"Bearer {os.environ['SPARRING_TOKEN']}"} if os.environ.get("SPARRING_TOKEN") else {}


class SessionLost(Exception):
    """The server no longer has the session: it was restarted, or the client was disconnected for too long."""


class Session:
    """Session that survives a lost connection: unanswered messages are sent again, and the server executes them once."""

    def __init__(self, base_url, **settings):
        self.url = base_url.replace("http", "ws", 1) + "/v1/sessions"
        self.message_id = 0
        self.stack = contextlib.ExitStack()
        self.opened = self.connect({"type": "open", "version": 2, **settings})

    def connect(self, message):
        """Connects and sends the first message, which opens or resumes a session."""
        for attempt in range(60):
            try:
                self.socket = self.stack.enter_context(connect(self.url, max_size=None, additional_headers=TOKEN))
                return self.send(message)
            except (OSError, ConnectionClosed, InvalidHandshake, SessionLost) as error:
                if attempt == 59 or (message["type"] == "resume" and isinstance(error, SessionLost)):
                    raise
                time.sleep(1)  # the server is restarting

    def send(self, message):
        """Sends a message and returns the response."""
        self.socket.send(json.dumps(message))
        response = json.loads(self.socket.recv())
        if response["type"] == "error" and response["code"] in ("unknown_session", "stopping"):
            raise SessionLost(response["detail"])
        if response["type"] == "error":
            raise RuntimeError(f"{response['field']}: {response['detail']}")
        return response

    def request(self, kind, **fields):
        """Sends a step or a reset. The server detects a repetition by the id of the message."""
        self.message_id += 1
        while True:
            try:
                return self.send({"type": kind, "id": self.message_id, **fields})
            except (ConnectionClosed, OSError):
                self.connect({"type": "resume", "session": self.opened["session"]})

    def close(self):
        self.send({"type": "close"})
        self.stack.close()


def choose_burns(observation):
    """Burns away from the debris with the closest approach in the next four steps, if all bodies move in straight lines."""
    burns = []
    for satellite in observation["satellites"]:
        if satellite["fuel"] <= 1.0:
            continue
        x, y, vx, vy = (satellite[name] for name in ("x", "y", "vx", "vy"))
        nearest, direction = 5.0, None
        for body in observation["radar_debris"]:
            for steps in (1, 2, 3, 4):
                dx = x + vx * steps - body["x"] - body["vx"] * steps
                dy = y + vy * steps - body["y"] - body["vy"] * steps
                distance = (dx * dx + dy * dy) ** 0.5
                if distance < nearest:
                    nearest, direction = distance, (dx / (distance + 1e-9), dy / (distance + 1e-9))
        if direction:
            delta_v = {"delta_vx": 0.3 * direction[0], "delta_vy": 0.3 * direction[1]}
            burns.append({"satellite_id": satellite["id"], **delta_v})
    return {"burns": burns}


def main(base_url, episodes):
    body = json.dumps({"tasks": ["kessler/survival"]}).encode()
    request = urllib.request.Request(base_url + "/v1/runs", body, {"content-type": "application/json", **TOKEN})
    run = json.load(urllib.request.urlopen(request))["id"]
    session, finished = Session(base_url, run=run), 0
    response = session.opened
    while finished < episodes:
        try:
            while not response.get("done"):
                response = session.request("step", action=choose_burns(response["observation"]))
                if finished == 0 and response["step"] == 10:
                    session.socket.close_socket()  # a lost connection; the episode continues
            outcome, finished = response["reported"], finished + 1
            score = f"score {outcome['score']:.3f} success {outcome['success']}"
            print(f"{outcome['episode']} {outcome['status']} {score}", flush=True)
            if finished < episodes:
                response = session.request("reset")  # the next scenario of the curriculum
        except SessionLost:  # the server offers the lost episode again when its lease expires
            session = Session(base_url, run=run)
            response = session.opened
    session.close()


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("usage: python examples/step.py URL [EPISODES], for example http://127.0.0.1:8700 4")
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 6)
