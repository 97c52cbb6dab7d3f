"""A trainer that flies on the server, one environment over one WebSocket: python step.py http://127.0.0.1:8700 [episodes]

Needs `websockets` (pip install websockets) and nothing else; docs/stepping.md has every frame. The curriculum of a run decides
what is flown, the server keeps the actions, and the last step of an episode is answered once its outcome is stored.
"""
import contextlib
import json
import os
import sys
import time
import urllib.request

from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import connect

# Where the server wants a token.
TOKEN = {"Authorization": f"Bearer {os.environ['SPARRING_TOKEN']}"} if os.environ.get("SPARRING_TOKEN") else {}


class Lost(Exception):
    """The server has no such session any more: it was started anew, or the connection was gone for too long."""


class Session:
    """A session that outlasts its connection: what was not answered is sent again, and is not done twice."""

    def __init__(self, base, **wish):
        self.url = base.replace("http", "ws", 1) + "/v1/sessions"
        self.number = 0
        self.stack = contextlib.ExitStack()
        self.opened = self.connect({"type": "open", "version": 1, **wish})

    def connect(self, message):
        """Connects, and says what the connection is for."""
        for attempt in range(60):
            try:
                self.socket = self.stack.enter_context(connect(self.url, max_size=None, additional_headers=TOKEN))
                return self.ask(message)
            except (OSError, ConnectionClosed, InvalidHandshake, Lost) as why:
                if attempt == 59 or (message["type"] == "resume" and isinstance(why, Lost)):
                    raise
                time.sleep(1)  # the server is away for a moment

    def ask(self, message):
        self.socket.send(json.dumps(message))
        told = json.loads(self.socket.recv())
        if told["type"] == "error" and told["code"] in ("unknown_session", "stopping"):
            raise Lost(told["detail"])
        if told["type"] == "error":
            raise RuntimeError(f"{told['field']}: {told['detail']}")
        return told

    def do(self, kind, **fields):
        """A step or a reset. Its number tells the server whether it was done already."""
        self.number += 1
        while True:
            try:
                return self.ask({"type": kind, "id": self.number, **fields})
            except (ConnectionClosed, OSError):
                self.connect({"type": "resume", "session": self.opened["session"]})

    def close(self):
        self.ask({"type": "close"})
        self.stack.close()


def burns(seen):
    """Away from whatever comes nearest in the next four steps, as if everything flew straight."""
    actions = []
    for satellite in (s for s in seen["satellites"] if s["fuel"] > 1.0):
        x, y, vx, vy = (satellite[name] for name in ("x", "y", "vx", "vy"))
        nearest, away = 5.0, None
        for body in seen["radar_debris"]:
            for ahead in (1, 2, 3, 4):
                dx = x + vx * ahead - body["x"] - body["vx"] * ahead
                dy = y + vy * ahead - body["y"] - body["vy"] * ahead
                distance = (dx * dx + dy * dy) ** 0.5
                if distance < nearest:
                    nearest, away = distance, (dx / (distance + 1e-9), dy / (distance + 1e-9))
        if away:
            actions.append({"satellite_id": satellite["id"], "delta_vx": 0.3 * away[0], "delta_vy": 0.3 * away[1]})
    return {"burns": actions}


def main(base, episodes):
    body = json.dumps({"tasks": ["kessler/survival"]}).encode()
    request = urllib.request.Request(base + "/v1/runs", body, {"content-type": "application/json", **TOKEN})
    run = json.load(urllib.request.urlopen(request))["id"]
    session, episode = Session(base, run=run), 0
    told = session.opened
    while episode < episodes:
        try:
            while not told.get("done"):
                told = session.do("step", action=burns(told["observation"]))
                if episode == 0 and told["step"] == 10:
                    session.socket.close_socket()  # a cable is pulled; the flight goes on
            receipt, episode = told["reported"], episode + 1
            print(f"{receipt['episode']} {receipt['status']} score {receipt['score']:.3f} success {receipt['success']}", flush=True)
            told = session.do("reset") if episode < episodes else told  # the same wish: whatever the curriculum proposes next
        except Lost:  # what was being flown is offered again, by the end of its lease; a new session goes on
            session = Session(base, run=run)
            told = session.opened
    session.close()


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("python step.py http://127.0.0.1:8700 [episodes]")
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 6)
