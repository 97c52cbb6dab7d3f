"""Tests the wheels that are installed beside this Python: PYTHON -I scripts/installed-wheels.py

scripts/test-wheels runs it in environments that have both wheels, and neither Rust nor this repository. It prints the versions
of the environment as JSON, or raises an error for the first check that fails.
"""

import contextlib
import hashlib
import json
import os
import platform
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import urllib.request
from importlib.metadata import version
from pathlib import Path

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test

import sparring

#: Hash of `step_with_fixed_actions` for each task, the same on every interpreter and machine and for every version of NumPy.
#: A change of the physics, the scenarios, the observations or the rewards changes it.
GOLDEN = {
    "docking/multiagent": "0c1a59ee5a997b73",
    "docking/single": "0faf6a8be671ce2d",
    "kessler/eco_station": "74dec47f7d4c540a",
    "kessler/formation": "ca093c09e3820728",
    "kessler/rendezvous": "0f0144655435d1f3",
    "kessler/survival": "e351ec4c3ec6fdc1",
    "tasking/constellation": "ba6ea7bedcfec9c0",
    "tasking/imaging": "2b4b1ed537398965",
    "tasking/scanning": "fbd2f1f1a89dd3d2",
}
SETTINGS = {"tasks": ["kessler/survival"], "placement": False, "design": {"designer": "off"}, "group_size": 4}
STEPS = 120
#: Timeout of the program's commands, seconds.
TIMEOUT_S = 120


def program():
    """Returns the path of the program that the wheel sparring-server installed."""
    path = Path(sys.executable).parent / "sparring"
    assert path.is_file(), f"{path} is missing: the wheel sparring-server does not install the program"
    return str(path)


def check_environment():
    """Checks that the package is that of the wheel, and that no compiler of Rust could have built it."""
    assert sys.flags.isolated, "run this file with python -I"
    assert Path(sparring.__file__).is_relative_to(sys.prefix), f"{sparring.__file__} is not in the environment {sys.prefix}"
    assert sparring._native.__file__.endswith("_native.abi3.so"), sparring._native.__file__
    for tool in ("cargo", "rustc", "maturin"):
        assert shutil.which(tool) is None, f"{shutil.which(tool)} is on the path: the environment must have no Rust"


def check_versions():
    """Checks that both wheels, the module and the program have one version."""
    printed = subprocess.run([program(), "--version"], check=True, capture_output=True, text=True, timeout=TIMEOUT_S).stdout
    versions = {version("sparring"), version("sparring-server"), sparring.__version__, printed.split()[1]}
    assert len(versions) == 1, f"the wheels have different versions: {versions}"


def step_with_fixed_actions(task):
    """Steps four environments with actions that are a function of the step; returns the hash of the results."""
    envs = sparring.make_vec(task, num_envs=4, level=3, threads=2)
    digest = hashlib.sha256()
    observations, _ = envs.reset(seed=11)
    digest.update(np.ascontiguousarray(observations).tobytes())
    size = int(np.prod(envs.action_space.shape))
    for step in range(STEPS):
        numbers = np.arange(size) * 37 + step * 11
        if isinstance(envs.single_action_space, gymnasium.spaces.MultiDiscrete):
            actions = numbers % envs.single_action_space.nvec[0]
        else:
            actions = (numbers % 201 - 100).astype(np.float32) / np.float32(100)
        for part in envs.step(actions.reshape(envs.action_space.shape))[:4]:
            digest.update(np.ascontiguousarray(part).tobytes())
    envs.close()
    return digest.hexdigest()[:16]


def check_golden_results():
    """Checks that vector environments compute the recorded results, to the bit."""
    results = {task: step_with_fixed_actions(task) for task in sorted(sparring.ENVIRONMENTS.values())}
    assert results == GOLDEN, f"expected {GOLDEN}, got {results}"


def check_interfaces():
    """Runs the checkers of Gymnasium and PettingZoo."""
    for name in sorted(sparring.ENVIRONMENTS):
        check_env(gymnasium.make(name, disable_env_checker=True).unwrapped, skip_render_check=True)
    for task in sorted(sparring.ENVIRONMENTS.values()):
        parallel_api_test(sparring.parallel_env(task), num_cycles=60)


def check_demo():
    """Trains the built-in learner for some hundred episodes."""
    command = [program(), "demo", "--temporary", "--exit", "--json", "--task", "survival", "--episodes", "600"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S)
    assert ended.returncode == 0, f"sparring demo: {ended.stderr[-2000:]}"
    summary = json.loads(ended.stdout)
    task = summary["tasks"]["kessler/survival"]
    # Episodes of designed layouts are counted separately.
    assert task["episodes"] + task["designs"]["episodes"] == summary["episodes"] == 600, summary


def check_local_curriculum(form):
    """Trains vector environments on the curriculum of a server that the package starts."""
    with sparring.Curriculum.local(settings=SETTINGS, form=form, lease_groups=8) as curriculum:
        envs = sparring.make_vec(num_envs=16, curriculum=curriculum)
        envs.reset()
        for _ in range(160):
            envs.step(np.zeros(envs.action_space.shape, np.float32))
        envs.close()
        curriculum.flush()
        stats = curriculum.stats()
    submitted = stats["counted"] + stats["stored"] + stats["accepted"] + stats["unclaimed"] + stats["unsent"]
    assert stats["finished"] >= 32 and submitted == stats["finished"], stats
    assert stats["refused"] == stats["late"] == 0, stats


@contextlib.contextmanager
def served(database):
    """Starts a server; yields its URL, and checks that SIGTERM stops it with exit code 0."""
    command = [program(), "serve", "--bind", "127.0.0.1:0", "--db", str(database)]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        lines = []
        for line in server.stdout:
            lines.append(line)
            if found := re.search(r"serves at (http://\S+?)[.,]?\s", line):
                break
        else:
            raise AssertionError(f"sparring serve: {''.join(lines)[-2000:]}")
        yield found[1]
        server.send_signal(signal.SIGTERM)
        output, _ = server.communicate(timeout=TIMEOUT_S)
        assert server.returncode == 0, f"SIGTERM ended the server with {server.returncode}: {output[-2000:]}"
    finally:
        server.kill()
        server.communicate()


def check_server():
    """Leases and reports episodes by the typed client, then stops and restarts the server."""
    with tempfile.TemporaryDirectory() as folder:
        database = Path(folder) / "wheels.sqlite3"
        with served(database) as url, sparring.Client(url) as client:
            with urllib.request.urlopen(url + "/livez", timeout=30) as response:
                assert response.headers["sparring-version"] == sparring.__version__, response.headers
            run = client.runs.create(**SETTINGS)["id"]
            lease = client.leases.create(run, groups=2, ttl_s=60)
            results, scores = [], {}
            for group in lease["groups"]:
                scenario = sparring.Scenario.from_dict({**lease["recipes"][group["recipe"]], "seed": group["seed"]})
                outcome, actions = sparring.rollout(scenario, "heuristic")
                steps = [[[agent, *map(float, values)] for agent, values in enumerate(step)] for step in actions]
                results += [{"episode": name, "actions": {"steps": steps}} for name in group["episodes"]]
                scores.update(dict.fromkeys(group["episodes"], outcome.score))
            reported = client.results.report(run, results=results)["results"]
            assert len(reported) == 2 * SETTINGS["group_size"]
            assert {result["status"] for result in reported} == {"counted"}, reported
            assert all(result["score"] == scores[result["episode"]] for result in reported), "the replay has other scores"
        with served(database) as url, sparring.Client(url) as client:
            episodes = client.mastery.get(run)["tasks"][0]["results"]["episodes"]
            assert episodes == len(reported), f"{episodes} of {len(reported)} episodes are left after a restart"


def main():
    check_environment()
    check_versions()
    check_golden_results()
    check_interfaces()
    check_demo()
    for form in ("groups", "columns"):
        check_local_curriculum(form)
    check_server()
    has_gil = getattr(sys, "_is_gil_enabled", lambda: True)()
    environment = {
        "python": platform.python_version() + ("" if has_gil else " without GIL"),
        "libc": " ".join(platform.libc_ver()),
        "numpy": np.__version__,
        "gymnasium": gymnasium.__version__,
        "sparring": sparring.__version__,
    }
    print(json.dumps(environment))


if __name__ == "__main__":
    os.environ.pop("SPARRING_BIN", None)
    main()
