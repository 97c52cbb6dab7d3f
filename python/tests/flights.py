"""What tests of a curriculum fly with: a real server of their own, and how it comes back."""

import contextlib
import os
import subprocess
import threading
import time

import numpy as np
from conftest import BINARY

import sparring

SETTINGS = {"tasks": ["kessler/survival"], "placement": False, "design": {"designer": "off"}}


def local(**wish):
    wish = {"settings": SETTINGS, **wish}
    return sparring.Curriculum.local(binary=BINARY, **wish)


def apart(db=None, **wish):
    """A curriculum of a server that is another's, which may go and come back; and that other, who has the process."""
    owner = local(db=db)
    return owner, sparring.Curriculum(owner.url, owner.run, **wish)


@contextlib.contextmanager
def serve_again(db, url, after_s=0.0):
    """A server where one was that ended, on its database, after so long, until the block is left."""
    line = [BINARY, "serve", "--bind", url.removeprefix("http://"), "--db", os.fspath(db)]
    begun = []
    timer = threading.Timer(
        after_s, lambda: begun.append(subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
    )
    timer.start()
    try:
        yield
    finally:
        timer.join()
        for process in begun:
            process.terminate()
            process.wait()


def until(what, most=30.0):
    began = time.monotonic()
    while not what():
        assert time.monotonic() - began < most
        time.sleep(0.02)


def fly(envs, steps, size=0.0):
    rng = np.random.default_rng(1)
    ended = 0
    for _ in range(steps):
        actions = rng.uniform(-size, size, envs.action_space.shape).astype(np.float32)
        *_, infos = envs.step(actions)
        ended += infos["_episode"].sum() if "_episode" in infos else 0
    return int(ended)
