"""A trainer that steps many environments by binary frames: python vector.py http://127.0.0.1:8700 [leases]

Needs `websockets` (pip install websockets) and nothing else; docs/stepping.md has the bytes. It takes leases of a run and lets
32 environments fly their episodes; the server reports each as it ends. The policy is linear, and learns by evolution
strategies: every episode is flown by a variation of it, and what scored better counts more. With numpy, `numpy.frombuffer(frame,
dtype, count, offset)` gives the same columns without a copy.
"""
import contextlib
import json
import os
import random
import struct
import sys
import urllib.request
from array import array

from websockets.sync.client import connect

# Where the server wants a token.
TOKEN = {"Authorization": f"Bearer {os.environ['SPARRING_TOKEN']}"} if os.environ.get("SPARRING_TOKEN") else {}
ENVS, THREATS, SIGMA, RATE = 32, 2, 0.2, 0.1
HEADER = struct.Struct("<4sHHII")  # magic, version, kind, sequence, environments
ACTIONS, STEPPED, DONE, IDLE = 1, 2, 1, 2


class Vector:
    """A vector session: arrays in, columns out."""

    def __init__(self, base, **wish):
        assert sys.byteorder == "little", "frames are little-endian"
        self.stack = contextlib.ExitStack()
        url = base.replace("http", "ws", 1) + "/v1/sessions"
        self.socket = self.stack.enter_context(connect(url, max_size=None, compression=None, additional_headers=TOKEN))
        self.told = self.ask({"type": "open", "version": 1, **wish})
        assert self.told["version"] == 1
        self.envs, self.agents, self.sequence = self.told["envs"], self.told["agents"], 0
        self.first = self.read(self.socket.recv())

    def ask(self, message):
        self.socket.send(json.dumps(message))
        return self.check(self.socket.recv())

    def check(self, text):
        told = json.loads(text)
        if told["type"] == "error":
            raise RuntimeError(f"{told['field']}: {told['detail']}")
        return told

    def read(self, frame):
        if isinstance(frame, str):
            self.check(frame)  # errors are text
        magic, version, kind, sequence, envs = HEADER.unpack_from(frame)
        assert (magic, version, kind, sequence, envs) == (b"SPVF", 1, STEPPED, self.sequence, self.envs)
        columns = {}
        for field in self.told["frames"]["stepped"]["fields"]:
            if "done" in field["shape"]:
                continue
            code, size = {"<f4": ("f", 4), "<i4": ("i", 4), "|u1": ("B", 1)}[field["dtype"]]
            count = size
            for length in field["shape"]:
                count *= length
            columns[field["name"]] = memoryview(frame)[field["offset"]:field["offset"] + count].cast(code)
        return columns

    def step(self, actions):
        self.sequence += 1
        self.socket.send(HEADER.pack(b"SPVF", 1, ACTIONS, self.sequence, self.envs) + actions.tobytes())
        return self.read(self.socket.recv())

    def close(self):
        told = self.ask({"type": "close"})  # answered once all is reported
        self.stack.close()
        return told["reported"]


def post(base, path, body):
    request = urllib.request.Request(base + path, json.dumps(body).encode(), {"content-type": "application/json", **TOKEN})
    return json.load(urllib.request.urlopen(request))


def fly(base, run, theta, version, rng):
    """Flies a lease; the variation of every episode with what it scored, and what became of them."""
    lease = post(base, f"/v1/runs/{run}/leases", {"groups": 32, "policy_version": version})["lease"]
    vector = Vector(base, run=run, lease_id=lease, vector={"envs": ENVS, "observe": "tracks", "threats": THREATS})
    cells = vector.told["observation"] // vector.agents
    if not theta:
        theta.extend([0.0] * (2 * cells))
    tried, scores = {}, {}
    seen = vector.first
    while not all(flags & IDLE for flags in seen["flags"]):
        actions, rows = array("f", bytes(8 * ENVS * vector.agents)), seen["observations"]
        flying = list(seen["episodes"])
        for env, episode in enumerate(flying):
            if episode < 0:
                continue
            if episode not in tried:
                tried[episode], scores[episode] = [rng.gauss(0.0, 1.0) for _ in theta], 0.0
            weights = [mean + SIGMA * noise for mean, noise in zip(theta, tried[episode])]
            for agent in range(vector.agents):
                at = env * vector.agents + agent
                row = rows[at * cells:(at + 1) * cells]
                for axis in (0, 1):
                    told = sum(weight * cell for weight, cell in zip(weights[axis * cells:(axis + 1) * cells], row))
                    actions[2 * at + axis] = max(-1.0, min(1.0, told)) if abs(told) > 0.05 else 0.0
        seen = vector.step(actions)
        for env, episode in enumerate(flying):
            if episode >= 0:
                scores[episode] += seen["team_rewards"][env]
    return tried, scores, vector.close()


def main(base, leases):
    rng = random.Random(7)
    # Nothing is designed for its failures: scores would fall with what it learns. With layouts, those are told as `stored`.
    wish = {"tasks": ["kessler/survival"], "placement": False, "group_size": 1, "design": {"designer": "off"}}
    run = post(base, "/v1/runs", wish)["id"]
    theta, means = [], []
    for version in range(1, leases + 1):
        tried, scores, told = fly(base, run, theta, version, rng)
        mean = sum(scores.values()) / len(scores)
        spread = (sum((score - mean) ** 2 for score in scores.values()) / len(scores)) ** 0.5 + 1e-6
        for place in range(len(theta)):
            pull = sum((scores[episode] - mean) / spread * noise[place] for episode, noise in tried.items())
            theta[place] += RATE * pull / len(tried)
        means.append(mean)
        lately = sum(means[-10:]) / len(means[-10:])
        print(f"lease {version}: mean score {mean:.3f}, of the last ten {lately:.3f}, {told['flown']} flown, {told['counted']} counted")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("python vector.py http://127.0.0.1:8700 [leases]")
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 100)
