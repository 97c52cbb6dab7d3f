"""A curriculum whose server fails or restarts, and whose process ends, forks or is interrupted."""

import gc
import os
import signal
import subprocess
import sys
import threading
import time

import pytest
from conftest import BINARY, needs_server
from curriculum_servers import (
    SETTINGS,
    kill_server,
    local_curriculum,
    remote_curriculum,
    restarted_server,
    step_randomly,
    wait_until,
)

import sparring

pytestmark = needs_server


@pytest.fixture
def interrupt_after():
    """Returns a function that sends Ctrl-C after some seconds.

    It restores Python's handler, which a shell disables for tests in the background.
    """
    previous = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield lambda seconds: threading.Timer(seconds, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    signal.signal(signal.SIGINT, previous)


def make_envs(curriculum, num_envs):
    """Makes and resets environments of a curriculum."""
    envs = sparring.make_vec(num_envs=num_envs, curriculum=curriculum)
    envs.reset()
    return envs


def wait_for_ready(curriculum, episodes):
    wait_until(lambda: curriculum.stats()["ready"] >= episodes)


def test_killed_server_loses_no_result(tmp_path):
    db = tmp_path / "run.sqlite3"
    owner, curriculum = remote_curriculum(db=db, form="groups", lease_groups=64, ahead=300, max_wait_s=60)
    envs = make_envs(curriculum, 16)
    step_randomly(envs, 60)
    wait_for_ready(curriculum, 300)
    kill_server(owner)
    ended = step_randomly(envs, 200)
    assert ended > 40
    stats = curriculum.stats()
    assert stats["unreachable_s"] is not None
    assert stats["unsent"] >= 40
    with restarted_server(db, curriculum.url):
        step_randomly(envs, 100)
        envs.close()
        curriculum.flush()
        stats = curriculum.stats()
        assert stats["counted"] + stats["stored"] + stats["duplicate"] == stats["finished"]
        assert stats["late"] == 0
        curriculum.close()


def test_long_outage_raises_and_keeps_results():
    owner, curriculum = remote_curriculum(form="groups", lease_groups=16, max_wait_s=3.0)
    envs = make_envs(curriculum, 8)
    kill_server(owner)
    started = time.monotonic()
    with pytest.raises(sparring.CurriculumError, match="unreachable"):
        step_randomly(envs, 2000)
    assert time.monotonic() - started < 60, "a step waits for 3 s here, and for 60 s by default"
    assert curriculum.stats()["unsent"] == curriculum.stats()["finished"] > 0
    envs.close()
    with pytest.raises(sparring.CurriculumError, match="could not be submitted"):
        curriculum.close(timeout_s=1)
    stats = curriculum.stats()
    assert (stats["unsent"], stats["lost"]) == (0, stats["finished"])
    owner.close()


def test_dead_local_server_is_not_waited_for():
    curriculum = local_curriculum(form="groups", lease_groups=16)
    reopened = curriculum.reopen(form="groups", lease_groups=16)
    batches = [make_envs(opened, 8) for opened in (curriculum, reopened)]
    started = time.monotonic()
    curriculum._server._process.kill()
    for envs, opened in zip(batches, (curriculum, reopened), strict=True):
        with pytest.raises(sparring.CurriculumError, match=r"no episode for .*; the server that was started here was killed"):
            step_randomly(envs, 2000)
        with pytest.raises(sparring.CurriculumError, match="wait to be submitted; the server that was started here"):
            opened.flush()
    for opened in (reopened, curriculum):
        with pytest.raises(sparring.CurriculumError, match=r"^\d+ finished .* submitted; the server that was started here"):
            opened.close()
        stats = opened.stats()
        assert (stats["unsent"], stats["lost"]) == (0, stats["finished"]) != (0, 0)
    assert time.monotonic() - started < 60, "waiting and closing may take a minute each"


@pytest.mark.parametrize("form", ["groups", "columns"])
def test_server_with_another_database_refuses_results(tmp_path, form):
    owner, curriculum = remote_curriculum(form=form, lease_groups=16, ahead=8)
    envs = make_envs(curriculum, 8)
    wait_for_ready(curriculum, 8)
    kill_server(owner)
    finished = step_randomly(envs, 60)
    assert curriculum.stats()["finished"] == finished >= 8
    refused = pytest.raises(sparring.CurriculumError, match=rf"404.*refused in all: {finished} episodes")
    with restarted_server(tmp_path / "other.sqlite3", owner.url), refused:
        curriculum.close()
    stats = curriculum.stats()
    assert (stats["refused"], stats["unsent"], stats["lost"]) == (finished, 0, 0)
    owner.close()


def test_close_releases_leases_that_arrive_late():
    with local_curriculum(form="groups", lease_groups=64, ahead=500) as curriculum:
        # Each reopened curriculum is closed while a lease request is under way.
        for _ in range(5):
            reopened = curriculum.reopen(form="groups", lease_groups=64, ahead=500)
            make_envs(reopened, 2).close()
            reopened.close()
        leases = curriculum.request("GET", f"/v1/runs/{curriculum.run}/leases")["leases"]
        assert len(leases) >= 5
        assert not [lease for lease in leases if lease["status"] == "active"], leases


def test_local_server_ends_with_its_process(tmp_path):
    program = f"""
import os, sparring
curriculum = sparring.Curriculum.local({os.fspath(tmp_path / "run.sqlite3")!r}, binary={BINARY!r}, settings={SETTINGS!r})
print(curriculum._server._process.pid, flush=True)
os.kill(os.getpid(), 9)
"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300)
    pid = int(ended.stdout)

    def is_gone():
        try:
            with open(f"/proc/{pid}/stat") as stat:
                return stat.read().rsplit(")", 1)[1].split()[0] == "Z"
        except FileNotFoundError:
            return True

    wait_until(is_gone)


def test_temporary_database_is_deleted_after_a_kill(tmp_path):
    program = f"""
import os, sparring
curriculum = sparring.Curriculum.local(binary={BINARY!r}, settings={SETTINGS!r})
print(os.listdir({os.fspath(tmp_path)!r}), flush=True)
os.kill(os.getpid(), 9)
"""
    environment = {**os.environ, "TMPDIR": os.fspath(tmp_path)}
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300, env=environment)
    assert "sparring-" in ended.stdout
    wait_until(lambda: not os.listdir(tmp_path))


def test_failed_reset_changes_nothing(tmp_path):
    db = tmp_path / "run.sqlite3"
    owner, curriculum = remote_curriculum(db=db, form="groups", lease_groups=16, ahead=8, max_wait_s=3.0)
    envs = make_envs(curriculum, 16)
    step_randomly(envs, 20)
    kill_server(owner)
    with pytest.raises(sparring.CurriculumError):
        step_randomly(envs, 2000)
    for _ in range(3):
        with pytest.raises(sparring.CurriculumError):
            envs.reset()
    with restarted_server(db, curriculum.url):
        wait_until(lambda: curriculum.stats()["unreachable_s"] is None)
        wait_for_ready(curriculum, 16)
        step_randomly(envs, 130)
        envs.close()
        curriculum.flush()
        stats = curriculum.stats()
        assert stats["counted"] + stats["stored"] + stats["duplicate"] == stats["finished"] > 16
        curriculum.close()


@pytest.mark.parametrize("end", ["", "raise KeyboardInterrupt", "import os; os.fork() or os._exit(0)"])
def test_program_without_close_submits_results_at_exit(tmp_path, end):
    db = tmp_path / "run.sqlite3"
    program = f"""
import numpy as np, sparring
curriculum = sparring.Curriculum.local({os.fspath(db)!r}, binary={BINARY!r}, settings={SETTINGS!r}, form="groups")
envs = sparring.make_vec(num_envs=64, curriculum=curriculum)
envs.reset()
for _ in range(51):
    envs.step(np.zeros(envs.action_space.shape, np.float32))
print(curriculum.run, curriculum.stats()["finished"], flush=True)
{end}
"""
    ended = subprocess.run([sys.executable, "-W", "ignore", "-c", program], capture_output=True, text=True, timeout=300)
    run, finished = ended.stdout.split()
    assert int(finished) >= 64
    with local_curriculum(db=db, settings=None, run=run) as curriculum:
        overview = curriculum.request("GET", f"/v1/runs/{run}/overview")
    assert overview["episodes"] == int(finished), ended.stderr


def test_forked_process_raises_and_its_parent_continues():
    with local_curriculum(form="groups") as curriculum:
        envs = make_envs(curriculum, 4)
        child = os.fork()
        if child == 0:
            errors = 0
            for call in (
                lambda: step_randomly(envs, 1),
                envs.reset,
                curriculum.flush,
                curriculum.stats,
                lambda: sparring.make_vec(num_envs=4, curriculum=curriculum),
            ):
                try:
                    call()
                except (sparring.CurriculumError, RuntimeError) as error:
                    errors += "another process" in str(error)
            envs.close()
            curriculum.close()
            os._exit(errors)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 5
        assert step_randomly(envs, 60) >= 4
        envs.close()


def test_server_of_a_deleted_curriculum_stops():
    curriculum = local_curriculum(form="groups")
    process = curriculum._server._process
    del curriculum
    gc.collect()
    wait_until(lambda: process.poll() is not None)


def test_ctrl_c_interrupts_a_waiting_step(interrupt_after):
    with local_curriculum(form="groups", ahead=16) as curriculum:
        envs = make_envs(curriculum, 4)
        wait_for_ready(curriculum, 16)
        curriculum.request("POST", f"/v1/runs/{curriculum.run}/pause")
        interrupt_after(1.0)
        with pytest.raises(KeyboardInterrupt):
            step_randomly(envs, 100_000)
        envs.close()


def test_ctrl_c_interrupts_close_without_a_server(interrupt_after):
    owner, curriculum = remote_curriculum(form="groups", ahead=8)
    envs = make_envs(curriculum, 4)
    wait_for_ready(curriculum, 8)
    owner._server._process.kill()
    finished = step_randomly(envs, 60)
    envs.close()
    interrupt_after(0.5)
    started = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        curriculum.close(300)
    assert time.monotonic() - started < 60
    with pytest.raises(sparring.CurriculumError, match="could not be submitted"):
        curriculum.close(1)
    stats = curriculum.stats()
    assert stats["lost"] == stats["finished"] - stats["counted"] - stats["stored"] == finished > 0


def test_paused_run_is_named_in_the_error():
    with local_curriculum(form="groups", max_wait_s=3, lease_groups=1) as curriculum:
        envs = make_envs(curriculum, 4)
        curriculum.request("POST", f"/v1/runs/{curriculum.run}/pause")
        with pytest.raises(sparring.CurriculumError, match=r"no episode for .*; run .* is paused"):
            step_randomly(envs, 10_000)
        assert curriculum.stats()["paused"]
        assert curriculum.stats()["unreachable_s"] is None
        envs.close()


@pytest.mark.parametrize("timeout_s", [-1.0, float("nan"), "1", None])
def test_close_with_invalid_timeout_loses_nothing(timeout_s):
    curriculum = local_curriculum(form="groups")
    envs = make_envs(curriculum, 4)
    finished = step_randomly(envs, 60)
    with pytest.raises((ValueError, TypeError), match="timeout_s"):
        curriculum.close(timeout_s)
    envs.close()
    curriculum.close(float("inf"))
    stats = curriculum.stats()
    assert stats["counted"] + stats["stored"] == stats["finished"] == finished > 0


def test_deleted_curriculum_submits_results(tmp_path):
    db = tmp_path / "run.sqlite3"
    with local_curriculum(db=db) as owner:
        curriculum = sparring.Curriculum(owner.url, owner.run, form="columns", lease_groups=64)
        envs = make_envs(curriculum, 8)
        finished = step_randomly(envs, 60)
        before = set(os.listdir("/proc/self/task"))
        del curriculum, envs
        gc.collect()
        leases = owner.request("GET", f"/v1/runs/{owner.run}/leases?limit=100")["leases"]
        assert not [lease for lease in leases if lease["status"] == "active" and not lease.get("claim")], leases
        assert owner.request("GET", f"/v1/runs/{owner.run}/overview")["episodes"] >= 0
        wait_until(lambda: len(set(os.listdir("/proc/self/task")) & before) <= len(before) - 2)
        assert finished > 0


def test_evaluation_waits_for_a_restarting_server(tmp_path):
    db = tmp_path / "run.sqlite3"
    owner, curriculum = remote_curriculum(db=db, max_wait_s=30)
    kill_server(owner)
    with restarted_server(db, curriculum.url, 1.0), pytest.raises(sparring.CurriculumError, match=r"422: suite: .*nope"):
        sparring.evaluate(curriculum, None, suite="nope")
    owner, curriculum = remote_curriculum(db=None, max_wait_s=0.2)
    owner.close()
    with pytest.raises(sparring.CurriculumError, match="no server answers"):
        sparring.evaluate(curriculum, None)


def test_expired_lease_of_columns_is_late(tmp_path):
    db = tmp_path / "run.sqlite3"
    owner, curriculum = remote_curriculum(db=db, form="columns", lease_groups=16, ahead=1, ttl_s=3)
    envs = make_envs(curriculum, 8)
    step_randomly(envs, 20)
    wait_for_ready(curriculum, 8)
    kill_server(owner)
    step_randomly(envs, 60)
    time.sleep(3.5)  # tests the passing of time: the lease, which lives for 3 s, expires while no server runs
    with restarted_server(db, curriculum.url):
        step_randomly(envs, 400, 0.02)
        envs.close()
        curriculum.flush()
        stats = curriculum.stats()
        assert stats["late"] >= 8
        assert stats["accepted"] >= 8
        assert stats["error"] is None
        curriculum.close()


def test_dead_server_of_a_paused_run_is_unreachable():
    owner, curriculum = remote_curriculum(form="groups", lease_groups=1, max_wait_s=3)
    envs = make_envs(curriculum, 4)
    curriculum.request("POST", f"/v1/runs/{curriculum.run}/pause")
    with pytest.raises(sparring.CurriculumError, match="is paused"):
        step_randomly(envs, 10_000)
    owner._server._process.kill()
    # The next request is a second later or more; a step waits for 3 s.
    wait_until(lambda: not curriculum.stats()["paused"])
    with pytest.raises(sparring.CurriculumError, match="the server has been unreachable"):
        wait_until(lambda: step_randomly(envs, 1) < 0)
    envs.close()
    curriculum.close(1)  # all results are submitted; the leases expire


def test_hanging_server_does_not_block_close():
    with local_curriculum() as owner:
        curriculum = owner.reopen(form="groups", lease_groups=1, ahead=8)
        envs = make_envs(curriculum, 4)
        wait_for_ready(curriculum, 8)
        owner._server._process.send_signal(signal.SIGSTOP)
        envs.close()
        started = time.monotonic()
        try:
            curriculum.close(0.5)
        finally:
            owner._server._process.send_signal(signal.SIGCONT)
        assert time.monotonic() - started < 60
