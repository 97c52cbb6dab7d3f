"""A curriculum whose server dies and comes back, and whose program ends, forks or is interrupted."""

import gc
import os
import signal
import subprocess
import sys
import threading
import time

import pytest
from conftest import BINARY, served
from flights import SETTINGS, apart, fly, local, serve_again, until

import sparring

pytestmark = served


@pytest.fixture
def ctrl_c():
    """Presses Ctrl-C in so many seconds, also where tests run in the background of a shell, which makes them deaf to it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield lambda seconds: threading.Timer(seconds, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    signal.signal(signal.SIGINT, before)


def test_a_server_that_dies_loses_nothing(tmp_path):
    db = tmp_path / "run.sqlite3"
    owner, curriculum = apart(db=db, form="groups", lease=64, ahead=300, patience_s=60)
    envs = sparring.make_vec(num_envs=16, curriculum=curriculum)
    envs.reset()
    fly(envs, 60)
    until(lambda: curriculum.stats()["ready"] >= 300)
    server = owner._server
    server._process.send_signal(signal.SIGKILL)
    server._process.wait()
    ended = fly(envs, 200)
    assert ended > 40
    away = curriculum.stats()
    assert away["away_s"] is not None
    assert away["waiting"] >= 40
    with serve_again(db, curriculum.url):
        fly(envs, 100)
        envs.close()
        curriculum.flush()
        told = curriculum.stats()
        assert told["counted"] + told["stored"] + told["duplicate"] == told["flown"]
        assert told["late"] == 0
        curriculum.close()


def test_a_server_that_stays_away_is_told_and_what_was_flown_is_kept():
    owner, curriculum = apart(form="groups", lease=16, patience_s=0.5)
    envs = sparring.make_vec(num_envs=8, curriculum=curriculum)
    envs.reset()
    owner._server._process.kill()
    owner._server._process.wait()
    began = time.monotonic()
    with pytest.raises(sparring.CurriculumError, match="away"):
        fly(envs, 2000)
    assert time.monotonic() - began < 20
    assert curriculum.stats()["waiting"] == curriculum.stats()["flown"] > 0
    envs.close()
    with pytest.raises(sparring.CurriculumError, match="could not be handed in"):
        curriculum.close(timeout_s=1)
    told = curriculum.stats()
    assert (told["waiting"], told["lost"]) == (0, told["flown"])
    owner.close()


def test_a_server_of_its_own_that_dies_is_not_waited_for():
    curriculum = local(form="groups", lease=16)
    part = curriculum.beside(form="groups", lease=16)
    every = [sparring.make_vec(num_envs=8, curriculum=one) for one in (curriculum, part)]
    for envs in every:
        envs.reset()
    began = time.monotonic()
    curriculum._server._process.kill()
    for envs, one in zip(every, (curriculum, part), strict=True):
        with pytest.raises(sparring.CurriculumError, match="nothing to fly; the server that was started here was killed"):
            fly(envs, 2000)
        with pytest.raises(sparring.CurriculumError, match="wait to be handed in; the server that was started here"):
            one.flush()
    for one in (part, curriculum):
        with pytest.raises(sparring.CurriculumError, match=r"^\d+ episodes .* handed in; the server that was started here"):
            one.close()
        told = one.stats()
        assert (told["waiting"], told["lost"]) == (0, told["flown"]) != (0, 0)
    assert time.monotonic() - began < 20, "patience and closing take a minute each"


@pytest.mark.parametrize("form", ["groups", "columns"])
def test_what_a_server_does_not_know_is_refused(tmp_path, form):
    """One that comes back with another database, for example."""
    owner, curriculum = apart(form=form, lease=16)
    envs = sparring.make_vec(num_envs=8, curriculum=curriculum)
    envs.reset()
    until(lambda: curriculum.stats()["ready"] >= 8)
    owner._server._process.kill()
    owner._server._process.wait()
    flown = fly(envs, 60)
    assert curriculum.stats()["flown"] == flown >= 8
    refused = pytest.raises(sparring.CurriculumError, match=rf"404.*refused in all: {flown} episodes")
    with serve_again(tmp_path / "other.sqlite3", owner.url), refused:
        curriculum.close()
    told = curriculum.stats()
    assert (told["refused"], told["waiting"], told["lost"]) == (flown, 0, 0)
    owner.close()


def test_closing_gives_back_what_is_still_being_leased():
    with local(form="groups", lease=64, ahead=500) as curriculum:
        # Leases are asked for from here on; each part is closed while one is under way.
        for _ in range(5):
            part = curriculum.beside(form="groups", lease=64, ahead=500)
            envs = sparring.make_vec(num_envs=2, curriculum=part)
            envs.reset()
            envs.close()
            part.close()
        leases = curriculum.ask("GET", f"/v1/runs/{curriculum.run}/leases")["leases"]
        assert len(leases) >= 5
        assert not [lease for lease in leases if lease["status"] == "active"], leases


def test_a_server_ends_with_the_process_that_started_it(tmp_path):
    program = f"""
import os, sparring
curriculum = sparring.Curriculum.local({os.fspath(tmp_path / "run.sqlite3")!r}, binary={BINARY!r}, settings={SETTINGS!r})
print(curriculum._server._process.pid, flush=True)
os.kill(os.getpid(), 9)
"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    pid = int(ended.stdout)

    def gone():
        try:
            with open(f"/proc/{pid}/stat") as stat:
                return stat.read().rsplit(")", 1)[1].split()[0] == "Z"
        except FileNotFoundError:
            return True

    until(gone)


def test_what_is_to_be_forgotten_is_even_where_the_program_is_killed(tmp_path):
    program = f"""
import os, sparring
curriculum = sparring.Curriculum.local(binary={BINARY!r}, settings={SETTINGS!r})
print(os.listdir({os.fspath(tmp_path)!r}), flush=True)
os.kill(os.getpid(), 9)
"""
    where = {**os.environ, "TMPDIR": os.fspath(tmp_path)}
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, env=where)
    assert "sparring-" in ended.stdout
    until(lambda: not os.listdir(tmp_path))


def test_a_reset_that_fails_moves_nothing(tmp_path):
    db = tmp_path / "run.sqlite3"
    owner, curriculum = apart(db=db, form="groups", lease=16, ahead=8, patience_s=0.5)
    envs = sparring.make_vec(num_envs=16, curriculum=curriculum)
    envs.reset()
    fly(envs, 20)
    owner._server._process.kill()
    owner._server._process.wait()
    with pytest.raises(sparring.CurriculumError):
        fly(envs, 2000)
    for _ in range(3):
        with pytest.raises(sparring.CurriculumError):
            envs.reset()
    with serve_again(db, curriculum.url):
        until(lambda: curriculum.stats()["away_s"] is None)
        until(lambda: curriculum.stats()["ready"] >= 16)
        fly(envs, 130)
        envs.close()
        curriculum.flush()
        told = curriculum.stats()
        assert told["counted"] + told["stored"] + told["duplicate"] == told["flown"] > 16
        curriculum.close()


@pytest.mark.parametrize("end", ["", "raise KeyboardInterrupt", "import os; os.fork() or os._exit(0)"])
def test_who_ends_without_closing_has_what_was_flown_handed_in(tmp_path, end):
    db = tmp_path / "run.sqlite3"
    program = f"""
import numpy as np, sparring
curriculum = sparring.Curriculum.local({os.fspath(db)!r}, binary={BINARY!r}, settings={SETTINGS!r}, form="groups")
envs = sparring.make_vec(num_envs=64, curriculum=curriculum)
envs.reset()
for _ in range(51):
    envs.step(np.zeros(envs.action_space.shape, np.float32))
print(curriculum.run, curriculum.stats()["flown"], flush=True)
{end}
"""
    ended = subprocess.run([sys.executable, "-W", "ignore", "-c", program], capture_output=True, text=True, timeout=60)
    run, flown = ended.stdout.split()
    assert int(flown) >= 64
    with local(db=db, settings=None, run=run) as curriculum:
        told = curriculum.ask("GET", f"/v1/runs/{run}/overview")
    assert told["episodes"] == int(flown), ended.stderr


def test_a_forked_process_is_told_and_its_parent_flies_on():
    with local(form="groups") as curriculum:
        envs = sparring.make_vec(num_envs=4, curriculum=curriculum)
        envs.reset()
        child = os.fork()
        if child == 0:
            told = 0
            for what in (
                lambda: fly(envs, 1),
                envs.reset,
                curriculum.flush,
                curriculum.stats,
                lambda: sparring.make_vec(num_envs=4, curriculum=curriculum),
            ):
                try:
                    what()
                except (sparring.CurriculumError, RuntimeError) as error:
                    told += "another process" in str(error)
            envs.close()
            curriculum.close()
            os._exit(told)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 5
        assert fly(envs, 60) >= 4
        envs.close()


def test_a_server_that_nobody_has_any_more_is_stopped():
    curriculum = local(form="groups")
    process = curriculum._server._process
    del curriculum
    gc.collect()
    until(lambda: process.poll() is not None)


def test_waiting_is_interrupted_by_ctrl_c(ctrl_c):
    with local(form="groups") as curriculum:
        envs = sparring.make_vec(num_envs=4, curriculum=curriculum)
        envs.reset()
        until(lambda: curriculum.stats()["ready"] >= 16)
        curriculum.ask("POST", f"/v1/runs/{curriculum.run}/pause")
        ctrl_c(1.0)
        with pytest.raises(KeyboardInterrupt):
            fly(envs, 100_000)
        envs.close()


def test_closing_without_a_server_is_interrupted_and_says_what_is_lost(ctrl_c):
    owner, curriculum = apart(form="groups")
    envs = sparring.make_vec(num_envs=4, curriculum=curriculum)
    envs.reset()
    until(lambda: curriculum.stats()["ready"] >= 8)
    owner._server._process.kill()
    flown = fly(envs, 60)
    envs.close()
    ctrl_c(0.5)
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        curriculum.close(30)
    assert time.monotonic() - began < 5
    with pytest.raises(sparring.CurriculumError, match="could not be handed in"):
        curriculum.close(1)
    told = curriculum.stats()
    assert told["lost"] == told["flown"] - told["counted"] - told["stored"] == flown > 0


def test_a_run_that_is_paused_is_told_as_that():
    with local(form="groups", patience_s=2, lease=1) as curriculum:
        envs = sparring.make_vec(num_envs=4, curriculum=curriculum)
        envs.reset()
        curriculum.ask("POST", f"/v1/runs/{curriculum.run}/pause")
        with pytest.raises(sparring.CurriculumError, match=r"nothing to fly; run .* is paused"):
            fly(envs, 10_000)
        assert curriculum.stats()["paused"]
        assert curriculum.stats()["away_s"] is None
        envs.close()


@pytest.mark.parametrize("timeout_s", [-1.0, float("nan"), "1", None])
def test_who_closes_wrongly_has_lost_nothing(timeout_s):
    curriculum = local(form="groups")
    envs = sparring.make_vec(num_envs=4, curriculum=curriculum)
    envs.reset()
    flown = fly(envs, 60)
    with pytest.raises((ValueError, TypeError), match="timeout_s"):
        curriculum.close(timeout_s)
    envs.close()
    curriculum.close(float("inf"))
    told = curriculum.stats()
    assert told["counted"] + told["stored"] == told["flown"] == flown > 0


def test_who_forgets_a_curriculum_has_what_was_flown_handed_in(tmp_path):
    db = tmp_path / "run.sqlite3"
    with local(db=db) as owner:
        curriculum = sparring.Curriculum(owner.url, owner.run, form="columns", lease=64)
        envs = sparring.make_vec(num_envs=8, curriculum=curriculum)
        envs.reset()
        flown = fly(envs, 60)
        before = {thread for thread in os.listdir("/proc/self/task")}
        del curriculum, envs
        gc.collect()
        leases = owner.ask("GET", f"/v1/runs/{owner.run}/leases?limit=100")["leases"]
        assert not [lease for lease in leases if lease["status"] == "active" and not lease.get("claim")], leases
        assert owner.ask("GET", f"/v1/runs/{owner.run}/overview")["episodes"] >= 0
        until(lambda: len(set(os.listdir("/proc/self/task")) & before) <= len(before) - 2)
        assert flown > 0


def test_an_evaluation_begins_once_a_server_is_back(tmp_path):
    db = tmp_path / "run.sqlite3"
    owner, curriculum = apart(db=db, patience_s=30)
    owner._server._process.kill()
    owner._server._process.wait()
    with serve_again(db, curriculum.url, 1.0), pytest.raises(sparring.CurriculumError, match="there is no suite"):
        sparring.evaluate(curriculum, None, suite="nope")
    hasty = apart(db=None, patience_s=0.2)
    hasty[0].close()
    with pytest.raises(sparring.CurriculumError, match="no server answers"):
        sparring.evaluate(hasty[1], None)


def test_a_lease_of_columns_that_ran_out_is_told_as_late_and_training_goes_on(tmp_path):
    db = tmp_path / "run.sqlite3"
    owner, curriculum = apart(db=db, form="columns", lease=16, ahead=1, ttl_s=1)
    envs = sparring.make_vec(num_envs=8, curriculum=curriculum)
    envs.reset()
    fly(envs, 20)
    until(lambda: curriculum.stats()["ready"] >= 8)
    owner._server._process.kill()
    owner._server._process.wait()
    fly(envs, 60)
    time.sleep(1.5)
    with serve_again(db, curriculum.url):
        fly(envs, 400, 0.02)
        envs.close()
        curriculum.flush()
        told = curriculum.stats()
        assert told["late"] >= 8
        assert told["accepted"] >= 8
        assert told["fault"] is None
        curriculum.close()


def test_a_server_that_was_paused_and_died_is_told_as_dead():
    owner, curriculum = apart(form="groups", lease=1, patience_s=1)
    envs = sparring.make_vec(num_envs=4, curriculum=curriculum)
    envs.reset()
    curriculum.ask("POST", f"/v1/runs/{curriculum.run}/pause")
    with pytest.raises(sparring.CurriculumError, match="is paused"):
        fly(envs, 10_000)
    owner._server._process.kill()
    # It is asked again a second later, or more beside other work, which is as long as a step has patience.
    until(lambda: not curriculum.stats()["paused"])
    with pytest.raises(sparring.CurriculumError, match="the server is away"):
        until(lambda: fly(envs, 1) < 0)
    envs.close()
    curriculum.close(1)  # all that was flown is handed in; what was leased runs out


def test_a_server_that_hangs_keeps_nobody_who_closes():
    with local() as owner:
        curriculum = owner.beside(form="groups", lease=1)
        envs = sparring.make_vec(num_envs=4, curriculum=curriculum)
        envs.reset()
        until(lambda: curriculum.stats()["ready"] >= 8)
        owner._server._process.send_signal(signal.SIGSTOP)
        envs.close()
        began = time.monotonic()
        try:
            curriculum.close(0.5)
        finally:
            owner._server._process.send_signal(signal.SIGCONT)
        assert time.monotonic() - began < 10
