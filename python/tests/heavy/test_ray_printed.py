"""Code and commands of the guide to Ray: two nodes of `ray start` on this machine. Run by hand: make test-heavy"""

import contextlib
import os
import re
import shlex
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

pytest.importorskip("ray.rllib")
import ray
from conftest import BINARY, needs_server
from documents import COMMENT, PROMPT, ROOT, URL, blocks, code_blocks, replace_all
from test_rllib import local_curriculum

PAGE = "docs/guides/ray.md"
#: Options of trainings that take seconds.
SMALL_PPO = "--env-runners 2 --iterations 1 --envs 2 --no-evaluation"
SMALL_TUNE = "--env-runners 1 --iterations 1 --envs 2 --strategies ladder --verbose 0"


@needs_server
def test_printed_code_trains(tmp_path):
    tune_code, actors_code = code_blocks(PAGE)
    ray.init("local", num_cpus=2, include_dashboard=False, object_store_memory=100 * 2**20, log_to_driver=False)
    try:
        with local_curriculum(["kessler/survival"]) as curriculum:
            smaller = {
                URL: curriculum.url,
                'tune.grid_search(["auto", "ladder"])': '"ladder"',
                "tune.grid_search([5e-4, 1e-3])": "5e-4",
                "num_envs_per_env_runner=32": "num_envs_per_env_runner=2",
                "train_batch_size_per_learner=1600, minibatch_size=400": "train_batch_size_per_learner=120, minibatch_size=60",
                '"training_iteration": 40}': f'"training_iteration": 1}}, storage_path="{tmp_path}", verbose=0',
            }
            names = {}
            exec(compile(replace_all(tune_code, smaller), PAGE, "exec"), names)
            (result,) = names["results"]
            assert result.error is None and re.fullmatch(r"strategies-\w+", result.metrics["curriculum_run"])
            assert "kessler/survival/rung" in result.metrics["curriculum"]
            names = {}
            exec(compile(replace_all(actors_code, {URL: curriculum.url}), PAGE, "exec"), names)
            assert min(names["finished"]) >= 8
            counted = curriculum.request("GET", f"/v1/runs/{names['curriculum'].run}")["episodes"]
            assert counted == sum(names["finished"])
            names["curriculum"].close()
    finally:
        ray.shutdown()


def printed_commands():
    """Returns the commands of the page without prompts and comments."""
    text = "\n".join(block.text for block in blocks(PAGE) if block.language == "sh")
    lines = re.sub(r"\\\n\s*", "", text).splitlines()
    return [COMMENT.sub("", PROMPT.sub("", line)).strip() for line in lines if line]


def free_ports(count):
    """Returns numbers of ports that no process uses."""
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]


class Shell:
    """Runs printed commands with the environment of a new user of this machine."""

    def __init__(self, folder, ray_port):
        python = Path(sys.executable).parent
        self.folder = folder
        self.environment = {
            **os.environ,
            "HOME": os.fspath(folder),
            "PATH": os.pathsep.join([os.fspath(folder), os.fspath(python), os.environ["PATH"]]),
            "PYTHONPATH": os.fspath(ROOT / "python"),
            "PYTHONDONTWRITEBYTECODE": "1",
            "RAY_ADDRESS": f"127.0.0.1:{ray_port}",
        }
        (folder / "sparring").symlink_to(BINARY)
        (folder / "examples").symlink_to(ROOT / "examples")

    def run(self, command):
        """Runs a command to its end; returns its standard output."""
        words = shlex.split(command)
        ended = subprocess.run(words, cwd=self.folder, env=self.environment, capture_output=True, text=True, timeout=300)
        assert ended.returncode == 0, f"{command}\n{ended.stdout[-3000:]}{ended.stderr[-3000:]}"
        return ended.stdout

    @contextlib.contextmanager
    def background(self, command, pattern):
        """Runs a command for the duration of a block, which begins when its output contains a pattern."""
        log = self.folder / f"{len(list(self.folder.glob('*.log')))}.log"
        with log.open("w") as output:
            # A session of its own: `ray start --block` and its processes end together.
            process = subprocess.Popen(
                shlex.split(command), cwd=self.folder, env=self.environment, stdout=output, stderr=output, start_new_session=True
            )
        try:
            deadline = time.monotonic() + 120
            while not re.search(pattern, log.read_text()):
                assert process.poll() is None and time.monotonic() < deadline, f"{command}\n{log.read_text()[-3000:]}"
                time.sleep(0.1)
            yield
        finally:
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(60)
            process.kill()
            process.wait()


@needs_server
def test_printed_commands_train_on_started_nodes():
    server_port, ray_port, jobs_port = free_ports(3)
    token, serve, key, export, head, other, ppo, tune, trajectories, job = printed_commands()
    url = {"http://head:8700": f"http://127.0.0.1:{server_port}"}
    node = "--block --num-cpus 2 --object-store-memory 100000000 --temp-dir"
    # The paths of Ray's sockets must be short.
    with tempfile.TemporaryDirectory(prefix="ray-", dir="/tmp") as folder, contextlib.ExitStack() as stack:
        shell = Shell(Path(folder), ray_port)
        shared = {"--storage /shared/tune": f"--storage {folder}/tune"}
        shell.environment["SPARRING_TOKEN"] = shell.run(token).strip()
        stack.enter_context(shell.background(replace_all(serve, {"0.0.0.0:8700 &": f"127.0.0.1:{server_port}"}), "serves at"))
        shell.run(key)
        assert export == "export SPARRING_TOKEN=… RAY_AUTH_MODE=token"
        shell.environment["RAY_AUTH_MODE"] = "token"
        ports = f"--port {ray_port} --dashboard-port {jobs_port}"
        stack.enter_context(shell.background(f"{head} {ports} {node} {folder}/head", "Ray runtime started"))
        other = replace_all(other, {"head:6379": f"127.0.0.1:{ray_port}"})
        # Nodes with one folder would replace each other's copy of the program of a job.
        stack.enter_context(shell.background(f"{other} {node} {folder}/other", "Ray runtime started"))
        output = shell.run(replace_all(ppo, {**url, "--env-runners 16": SMALL_PPO}))
        assert re.search(r"^ +1  return .* [1-9]\d* episodes ", output, re.MULTILINE), output
        output = shell.run(replace_all(tune, {**url, **shared, "--env-runners 4": f"{SMALL_TUNE} --experiment printed"}))
        assert re.search(r"^printed-\w+  strategy ladder .* iterations 1 ", output, re.MULTILINE), output
        output = shell.run(replace_all(trajectories, {**url, "--actors 8": "--actors 2 --groups 8"}))
        assert re.search(r"^\d+ groups, .* actions with an advantage; groups by node: ", output, re.MULTILINE), output
        jobs = {"http://127.0.0.1:8265": f"http://127.0.0.1:{jobs_port}", "--env-runners 4": f"{SMALL_TUNE} --experiment job"}
        output = shell.run(replace_all(job, {**url, **shared, **jobs}))
        assert "succeeded" in output and re.search(r"job-\w+  strategy ladder .* iterations 1 ", output), output
