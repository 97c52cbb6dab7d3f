"""A trainer that steps many environments on the server by binary frames.

    pip install websockets
    sparring serve &
    python examples/vector.py http://127.0.0.1:8700 10     # the number of leases is optional (100)

It takes leases of a run, and 32 environments run their episodes. The server reports each episode when it ends. The policy is
linear and learns by evolution strategies: each episode runs a variation of it, and variations with higher scores have more
weight. docs/reference/stepping.md documents the frames. With NumPy, `numpy.frombuffer(frame, dtype, count, offset)` reads the
columns without a copy.
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

# Authorization header, if the server has tokens.
TOKEN = {"Authorization": f"Bearer {os.environ['SPARRING_TOKEN']}"} if os.environ.get("SPARRING_TOKEN") else {}
# Environments, observed pieces of debris, standard deviation of variations, learning rate.
ENVS, THREATS, SIGMA, LEARNING_RATE = 32, 2, 0.2, 0.1
# Header of a frame: magic, version, kind, sequence number, environments.
HEADER = struct.Struct("<4sHHII")
# Kinds of frames.
ACTIONS, STEPPED = 1, 2
# Flag of an environment for which no episode is left.
IDLE = 2


class VectorSession:
    """Vector session: sends actions as an array and returns columns."""

    def __init__(self, base_url, **settings):
        assert sys.byteorder == "little", "frames are little-endian"
        self.stack = contextlib.ExitStack()
        url = base_url.replace("http", "ws", 1) + "/v1/sessions"
        self.socket = self.stack.enter_context(connect(url, max_size=None, compression=None, additional_headers=TOKEN))
        self.opened = self.send({"type": "open", "version": 2, **settings})
        assert self.opened["version"] == 2
        self.envs, self.agents, self.sequence = self.opened["envs"], self.opened["agents"], 0
        self.first = self.read_frame(self.socket.recv())

    def send(self, message):
        """Sends a JSON message and returns the response."""
        self.socket.send(json.dumps(message))
        return self.read_message(self.socket.recv())

    def read_message(self, text):
        message = json.loads(text)
        if message["type"] == "error":
            raise RuntimeError(f"{message['field']}: {message['detail']}")
        return message

    def read_frame(self, frame):
        """Returns the columns of a frame by name."""
        if isinstance(frame, str):
            self.read_message(frame)  # errors are JSON messages
        magic, version, kind, sequence, envs = HEADER.unpack_from(frame)
        assert (magic, version, kind, sequence, envs) == (b"SPVF", 2, STEPPED, self.sequence, self.envs)
        columns = {}
        for field in self.opened["frames"]["stepped"]["fields"]:
            if "done" in field["shape"]:
                continue
            code, size = {"<f4": ("f", 4), "<i4": ("i", 4), "|u1": ("B", 1)}[field["dtype"]]
            for length in field["shape"]:
                size *= length
            columns[field["name"]] = memoryview(frame)[field["offset"] : field["offset"] + size].cast(code)
        return columns

    def step(self, actions):
        """Steps all environments and returns the columns of the result."""
        self.sequence += 1
        self.socket.send(HEADER.pack(b"SPVF", 2, ACTIONS, self.sequence, self.envs) + actions.tobytes())
        return self.read_frame(self.socket.recv())

    def close(self):
        """Closes the session once all episodes are reported; returns their counts."""
        closed = self.send({"type": "close"})
        self.stack.close()
        return closed["reported"]


def post(base_url, path, body):
    headers = {"content-type": "application/json", **TOKEN}
    request = urllib.request.Request(base_url + path, json.dumps(body).encode(), headers)
    return json.load(urllib.request.urlopen(request))


def linear_policy(weights, rows, cells, agents):
    """Yields the two values of each agent's action; values below 0.05 become zero, since a burn costs fuel."""
    for agent in range(agents):
        row = rows[agent * cells : (agent + 1) * cells]
        for axis in (0, 1):
            value = sum(weight * cell for weight, cell in zip(weights[axis * cells : (axis + 1) * cells], row))
            yield max(-1.0, min(1.0, value)) if abs(value) > 0.05 else 0.0


def run_lease(base_url, run, theta, version, rng):
    """Runs the episodes of a lease; returns the variation and the score of each episode, and the counts of the session."""
    lease = post(base_url, f"/v1/runs/{run}/leases", {"groups": 32, "policy_version": version, "disclosure": "begin"})["lease"]
    vector = {"envs": ENVS, "observe": "tracks", "threats": THREATS}
    session = VectorSession(base_url, run=run, lease_id=lease, vector=vector)
    cells = session.opened["observation"] // session.agents
    if not theta:
        theta.extend([0.0] * (2 * cells))
    variations, scores = {}, {}
    columns = session.first
    while not all(flags & IDLE for flags in columns["flags"]):
        actions, rows = array("f", bytes(8 * ENVS * session.agents)), columns["observations"]
        episodes = list(columns["episodes"])
        for env, episode in enumerate(episodes):
            if episode < 0:
                continue
            if episode not in variations:
                variations[episode], scores[episode] = [rng.gauss(0.0, 1.0) for _ in theta], 0.0
            weights = [mean + SIGMA * noise for mean, noise in zip(theta, variations[episode])]
            env_rows = rows[env * session.agents * cells : (env + 1) * session.agents * cells]
            for index, value in enumerate(linear_policy(weights, env_rows, cells, session.agents)):
                actions[2 * env * session.agents + index] = value
        columns = session.step(actions)
        for env, episode in enumerate(episodes):
            if episode >= 0:
                scores[episode] += columns["team_rewards"][env]
    return variations, scores, session.close()


def main(base_url, leases):
    rng = random.Random(7)
    # Without designed layouts: they target the policy's failures, so scores would not show what it learns.
    settings = {"tasks": ["kessler/survival"], "placement": False, "group_size": 1, "design": {"designer": "off"}}
    run = post(base_url, "/v1/runs", settings)["id"]
    theta, means = [], []
    for version in range(1, leases + 1):
        variations, scores, counts = run_lease(base_url, run, theta, version, rng)
        mean = sum(scores.values()) / len(scores)
        deviation = (sum((score - mean) ** 2 for score in scores.values()) / len(scores)) ** 0.5 + 1e-6
        for index in range(len(theta)):
            gradient = sum((scores[episode] - mean) / deviation * noise[index] for episode, noise in variations.items())
            theta[index] += LEARNING_RATE * gradient / len(variations)
        means.append(mean)
        recent = sum(means[-10:]) / len(means[-10:])
        episodes = f"{counts['finished']} finished, {counts['counted']} counted"
        print(f"lease {version}: mean score {mean:.3f}, of the last ten {recent:.3f}, {episodes}")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("usage: python examples/vector.py URL [LEASES], for example http://127.0.0.1:8700 10")
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 100)
