"""Helpers of curriculum tests: they start servers, step environments and wait for conditions."""

import contextlib
import os
import subprocess
import threading
import time

import numpy as np
from conftest import BINARY

import sparring

SETTINGS = {"tasks": ["kessler/survival"], "strategy": "ladder", "placement": False, "design": {"designer": "off"}}


def local_curriculum(**arguments):
    """Starts a server and opens a curriculum of it."""
    arguments = {"settings": SETTINGS, **arguments}
    return sparring.Curriculum.local(binary=BINARY, **arguments)


def remote_curriculum(db=None, **arguments):
    """Starts a server; returns its owner, and a curriculum that does not own the server."""
    owner = local_curriculum(db=db)
    return owner, sparring.Curriculum(owner.url, owner.run, **arguments)


def read_episodes(curriculum):
    """Returns the server's outcome, scenario and actions of each episode."""
    path = f"/v1/runs/{curriculum.run}/episodes"
    rows = curriculum.request("GET", f"{path}?limit=500")["episodes"]
    return [curriculum.request("GET", f"{path}/{row['episode']}") for row in rows]


class RecordedMetrics:
    """Source of the metrics of a curriculum that keeps the last ones, which change while episodes run."""

    def __init__(self, curriculum):
        self._curriculum = curriculum
        self.last = {}

    def metrics(self):
        self.last = self._curriculum.metrics()
        return self.last


def kill_server(owner):
    """Kills the server of a curriculum and waits for its end."""
    owner._server._process.kill()
    owner._server._process.wait()


@contextlib.contextmanager
def restarted_server(db, url, delay_s=0.0):
    """Starts a server with the address and database of one that has ended; stops it at the end of the block."""
    command = [BINARY, "serve", "--bind", url.removeprefix("http://"), "--db", os.fspath(db)]
    started = []
    timer = threading.Timer(
        delay_s, lambda: started.append(subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
    )
    timer.start()
    try:
        yield
    finally:
        timer.join()
        for process in started:
            process.terminate()
            process.wait()


def wait_until(condition, timeout_s=300.0):
    """Polls a condition until it is true; fails after `timeout_s`, which is generous because machines are often busy."""
    started = time.monotonic()
    while not condition():
        assert time.monotonic() - started < timeout_s, f"timeout after {timeout_s} s"
        time.sleep(0.02)


def step_randomly(envs, steps, size=0.0):
    """Steps environments by random actions of at most `size`; returns how many episodes ended."""
    rng = np.random.default_rng(1)
    ended = 0
    for _ in range(steps):
        actions = rng.uniform(-size, size, envs.action_space.shape).astype(np.float32)
        *_, infos = envs.step(actions)
        ended += infos["_episode"].sum() if "_episode" in infos else 0
    return int(ended)


def hold_to_end(env):
    """Runs an episode of a single or parallel environment to its end by holding."""
    if hasattr(env, "possible_agents"):
        while env.agents:
            env.step({})
        return
    over = False
    while not over:
        *_, terminated, truncated, _ = env.step(np.zeros(env.action_space.shape, np.float32))
        over = terminated or truncated
