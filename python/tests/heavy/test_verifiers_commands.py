"""`vf-eval` as a command, with a scripted and a small real model, and the installation of sparring-verifiers by uv.

Run by hand, as test_verifiers.py.
"""

import contextlib
import json
import os
import pathlib
import signal
import subprocess
import sys
import sysconfig
import time
import zipfile

import pytest
from chat_server import ChatServer, tool_call
from conftest import needs_server
from curriculum_servers import local_curriculum, wait_until
from documents import ROOT

import sparring

pytest.importorskip("verifiers.v1")
tomllib = pytest.importorskip("tomllib")

pytestmark = needs_server

SCRIPTS = pathlib.Path(sys.executable).parent
SETTINGS = {"tasks": ["kessler/survival"], "placement": False, "design": {"designer": "off"}, "group_size": 4}


def command_line(folder, curriculum, address, model, *more):
    """Returns the command that runs `vf-eval` with results in a folder."""
    command = [SCRIPTS / "vf-eval", "sparring-verifiers", "--env.taskset.url", curriculum.url, "--model", model]
    command += ["--client.base-url", address, "--client.api-key-var", "NO_KEY", "--no-push", "--no-rich", "--run.dir", "out"]
    return [*command, "-o", folder, *more]


def vf_eval(folder, *arguments):
    """Runs `vf-eval` in a folder; returns the ended process."""
    return subprocess.run(command_line(folder, *arguments), cwd=folder, capture_output=True, text=True, timeout=600)


def read_traces(folder):
    """Returns the stored traces of an evaluation."""
    lines = (folder / "out" / "traces.jsonl").read_text().splitlines()
    return [trace for line in lines for trace in json.loads(line)["traces"]]


def stored_scores(curriculum, traces):
    """Returns the server's scores of the episodes of traces."""
    ids = [trace["info"]["sparring"] for trace in traces]
    return [curriculum.request("GET", f"/v1/runs/{id['run']}/episodes/{id['episode']}")["score"] for id in ids]


@contextlib.contextmanager
def small_model():
    """Serves SmolLM2 by scripts/serve-llm during the block; yields the address of the API and the model."""
    command = [sys.executable, ROOT / "scripts" / "serve-llm"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            address, name = process.stdout.readline().split()
            yield f"{address}/v1", name
        finally:
            process.terminate()


def test_command_stores_the_servers_scores(tmp_path):
    chat = ChatServer([[], [[tool_call("fire_thrusters", satellite_id=1, delta_vx=0.5, delta_vy=0.5)]]])
    with local_curriculum(settings=SETTINGS) as curriculum, chat.serving() as address:
        ended = vf_eval(tmp_path, curriculum, address, "scripted", "--env.taskset.run", curriculum.run, "-n", "2", "-r", "4")
        assert ended.returncode == 0, ended.stderr[-3000:]
        traces = read_traces(tmp_path)
        assert len(traces) == 8 and all(trace["ok"] for trace in traces)
        assert [trace["rewards"]["score"]["score"] for trace in traces] == stored_scores(curriculum, traces)
        assert curriculum.mastery()[0]["results"]["episodes"] == 8
        leases = curriculum.request("GET", f"/v1/runs/{curriculum.run}/leases")["leases"]
        assert [lease["status"] for lease in leases] == ["done", "done"]


def test_small_model_plays_through_the_command(tmp_path):
    with local_curriculum(settings=SETTINGS) as curriculum, small_model() as (address, name):
        options = ["--env.agent.max-turns", "3", "--sampling.max-tokens", "64", "-n", "2", "-r", "2", "-c", "2"]
        ended = vf_eval(tmp_path, curriculum, address, name, "--env.taskset.group-size", "2", *options)
        assert ended.returncode == 0, ended.stderr[-3000:]
        traces = read_traces(tmp_path)
        assert len(traces) == 4 and all(trace["ok"] for trace in traces)
        assert all(trace["num_output_tokens"] > 0 for trace in traces)
        assert [trace["rewards"]["score"]["score"] for trace in traces] == stored_scores(curriculum, traces)
        assert {trace["info"]["sparring"]["status"] for trace in traces} == {"counted"}


def test_interrupt_cancels_the_evaluation(tmp_path):
    chat = ChatServer([[]], on_request=lambda: time.sleep(1.0))
    with local_curriculum(settings=SETTINGS) as curriculum, chat.serving() as address:
        command = command_line(tmp_path, curriculum, address, "slow", "--env.taskset.suite", "kessler-heldout-v1", "-c", "4")
        with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as process:
            wait_until(lambda: len(chat.requests) > 8)
            process.send_signal(signal.SIGINT)
            _, errors = process.communicate(timeout=120)
        assert process.returncode == 130, errors[-3000:]
        (evaluation,) = curriculum.request("GET", "/v1/evaluations")["evaluations"]
        assert evaluation["state"] == "failed" and 0 < evaluation["scenarios_done"] < evaluation["scenarios"]
        leases = curriculum.request("GET", f"/v1/runs/{evaluation['run']}/leases?limit=500")["leases"]
        assert leases and not any(lease["status"] == "active" for lease in leases)


def test_command_names_invalid_arguments(tmp_path):
    with local_curriculum(settings=SETTINGS) as curriculum:
        for options, message in (
            (["--env.taskset.run", "a", "--env.taskset.suite", "b"], "`run` must be omitted with `suite`, got"),
            (["--env.taskset.suite", "none"], "ValueError: `suite` must be one of kessler-heldout-v2"),
        ):
            ended = vf_eval(tmp_path, curriculum, "http://127.0.0.1:1/v1", "none", *options)
            assert ended.returncode != 0 and message in ended.stderr, ended.stderr[-2000:]


def pack_sparring(folder):
    """Packs the package sparring with its built library as a wheel, as maturin does; returns its path."""
    project = tomllib.loads((ROOT / "python" / "pyproject.toml").read_text())["project"]
    extra = [f"Requires-Dist: {package} ; extra == 'client'" for package in project["optional-dependencies"]["client"]]
    needed = [f"Requires-Dist: {package}" for package in project["dependencies"]]
    version = sparring.__version__
    metadata = ["Metadata-Version: 2.1", "Name: sparring", f"Version: {version}", "Provides-Extra: client", *needed, *extra]
    tag = f"cp310-abi3-{sysconfig.get_platform().replace('-', '_')}"
    wheel = ["Wheel-Version: 1.0", "Generator: test", "Root-Is-Purelib: false", f"Tag: {tag}"]
    path = folder / f"sparring-{version}-{tag}.whl"
    texts = {"METADATA": "\n".join(metadata) + "\n", "WHEEL": "\n".join(wheel) + "\n"}
    with zipfile.ZipFile(path, "w") as archive:
        files = [file for file in (ROOT / "python" / "sparring").rglob("*") if file.is_file() and "__pycache__" not in file.parts]
        for file in files:
            archive.write(file, file.relative_to(ROOT / "python"))
        for name, text in texts.items():
            archive.writestr(f"sparring-{version}.dist-info/{name}", text)
        names = [*archive.namelist(), f"sparring-{version}.dist-info/RECORD"]
        archive.writestr(names[-1], "".join(f"{name},,\n" for name in names))
    return path


def test_uv_installs_the_package(tmp_path):
    pack_sparring(tmp_path)
    uv, venv = SCRIPTS / "uv", tmp_path / "venv"
    subprocess.run([uv, "venv", "--quiet", "--python", sys.executable, venv], check=True)
    install = [uv, "pip", "install", "--quiet", "--python", venv / "bin" / "python", "--find-links", tmp_path]
    subprocess.run([*install, ROOT / "python" / "verifiers"], check=True, timeout=900)
    code = (
        "import sparring, sparring_verifiers, verifiers.v1 as vf\n"
        "assert vf.import_taskset('sparring-verifiers') is sparring_verifiers\n"
        "env = sparring_verifiers.load_environment('http://127.0.0.1:1', suite='kessler-heldout-v2')\n"
        "print(sparring.__file__, sparring_verifiers.__file__, type(env).__name__)"
    )
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    run = subprocess.run(
        [venv / "bin" / "python", "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    *files, kind = run.stdout.split()
    assert all(file.startswith(os.fspath(venv)) for file in files) and kind == "SparringEnv"
    command = [venv / "bin" / "vf-eval", "sparring-verifiers", "--env.taskset.tasks", "survival", "--dry-run", "-o", tmp_path]
    subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, check=True)
