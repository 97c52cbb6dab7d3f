"""A curriculum of two servers behind nginx, which routes by the shard of a run's id."""

import contextlib
import os
import pathlib
import re
import shutil
import socket
import subprocess

import numpy as np
import pytest
from conftest import BINARY, needs_server
from curriculum_servers import SETTINGS, wait_until

import sparring

ROOT = pathlib.Path(__file__).parents[2]
NGINX = os.environ.get("NGINX", "/usr/sbin/nginx")

pytestmark = [needs_server, pytest.mark.skipif(not shutil.which(NGINX), reason="nginx is missing: run scripts/nginx")]


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextlib.contextmanager
def running(*command):
    """Runs a program for the time of the block."""
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def nginx_settings(folder, port, east, west):
    """Returns the configuration of operators with these ports, for a process without privileges."""
    text = (ROOT / "deploy/nginx.conf").read_text()
    text = text.replace("10.0.0.5:8700", f"127.0.0.1:{east}").replace("10.0.0.6:8700", f"127.0.0.1:{west}")
    text = re.sub(r"listen 80;", f"listen 127.0.0.1:{port};", text)
    names = ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
    paths = "".join(f"{name}_temp_path {folder}/{name};" for name in names)
    return f"daemon off; master_process off; pid {folder}/pid; events {{}} http {{ access_log off; {paths} {text} }}"


@contextlib.contextmanager
def two_shards(folder):
    """Starts the servers of the shards east and west, and nginx; returns the address of nginx."""
    east, west, port = free_port(), free_port(), free_port()
    (folder / "nginx.conf").write_text(nginx_settings(folder, port, east, west))
    with contextlib.ExitStack() as stack:
        for shard, own, peer, other in [("east", east, "west", west), ("west", west, "east", east)]:
            peers = f"{peer}=http://127.0.0.1:{other}"
            db = os.fspath(folder / f"{shard}.sqlite3")
            command = [BINARY, "serve", "--bind", f"127.0.0.1:{own}", "--db", db, "--shard", shard, "--peers", peers]
            stack.enter_context(running(*command))
        stack.enter_context(running(NGINX, "-p", os.fspath(folder), "-c", os.fspath(folder / "nginx.conf"), "-e", "stderr"))
        yield f"http://127.0.0.1:{port}"


def is_complete(client):
    """Returns True if both servers answer."""
    try:
        return not client.runs.list(limit=1)["missing_shards"]
    except (sparring.ApiError, sparring.ServerUnreachableError):
        return False


def test_curricula_of_both_shards_train_at_one_address(tmp_path):
    with two_shards(tmp_path) as url, sparring.Client(url) as client:
        wait_until(lambda: is_complete(client))
        curricula = [sparring.Curriculum(url, settings=SETTINGS, form="groups", lease_groups=8) for _ in range(2)]
        assert sorted(curriculum.run.split(".")[0] for curriculum in curricula) == ["east", "west"]
        for curriculum in curricula:
            envs = sparring.make_vec(num_envs=4, curriculum=curriculum)
            envs.reset()
            for _ in range(130):
                envs.step(np.zeros(envs.action_space.shape, np.float32))
            envs.close()
            curriculum.flush()
            assert curriculum.stats()["counted"] > 4
        page = client.runs.list(sort="episodes", order="desc")
        assert {run["id"] for run in page["runs"]} == {curriculum.run for curriculum in curricula}
        assert all(run["episodes"] > 4 for run in page["runs"])
        for curriculum in curricula:
            with sparring.Curriculum(url, curriculum.run) as again:
                assert again.tasks == ("kessler/survival",)
            curriculum.close()
        with pytest.raises(sparring.CurriculumError, match=r"east\.mine or west\.mine"):
            sparring.Curriculum(url, settings={**SETTINGS, "id": "mine"})
        with sparring.Curriculum(url, settings={**SETTINGS, "id": "west.mine"}) as chosen:
            assert chosen.run == "west.mine"
