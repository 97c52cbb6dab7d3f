"""A curriculum of a real server, through its death and resurrection."""

import gc
import os
import signal
import subprocess
import sys
import threading
import time

import gymnasium
import numpy as np
import pytest
from conftest import BINARY, served

import sparring

pytestmark = served
SETTINGS = {"tasks": ["kessler/survival"], "placement": False, "design": {"designer": "off"}}


def local(**wish):
    wish = {"settings": SETTINGS, **wish}
    return sparring.Curriculum.local(binary=BINARY, **wish)


def serve_again(db, url):
    """A server where one was that died, on its database."""
    line = [BINARY, "serve", "--bind", url.removeprefix("http://"), "--db", os.fspath(db)]
    return subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


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


@pytest.fixture
def ctrl_c():
    """Presses Ctrl-C in so many seconds, also where tests run in the background of a shell, which makes them deaf to it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield lambda seconds: threading.Timer(seconds, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("form", ["groups", "columns"])
@pytest.mark.parametrize("mode", ["next_step", "same_step"])
def test_episodes_are_flown_and_counted(form, mode):
    with local(form=form, lease=32) as curriculum:
        envs = sparring.make_vec(num_envs=16, curriculum=curriculum, autoreset_mode=mode)
        envs.reset()
        curriculum.policy_version = 3
        ended = fly(envs, 230, 0.02)
        assert (envs.levels >= 0).all(), "a server that is quick may have moved it by now"
        assert envs.train.all()
        envs.close()
        curriculum.flush()
        stats = curriculum.stats()
        assert stats["flown"] == ended > 60
        assert stats["refused"] == stats["late"] == stats["duplicate"] == 0
        if form == "columns":
            assert stats["accepted"] + stats["waiting"] <= ended
            assert stats["accepted"] >= 32
        else:
            assert stats["counted"] + stats["stored"] == ended
        curriculum.close()
        told = curriculum.stats()
        assert told["waiting"] == 0


def test_a_run_of_several_tasks_is_flown_by_one_batch():
    settings = {**SETTINGS, "tasks": ["kessler/survival", "kessler/rendezvous", "kessler/formation"]}
    with local(settings=settings, form="groups", lease=16) as curriculum:
        envs = sparring.make_vec(num_envs=8, curriculum=curriculum)
        envs.reset()
        tasks = set()
        for _ in range(120):
            envs.step(np.zeros(envs.action_space.shape, np.float32))
            tasks |= {envs.scenario(env).task for env in range(8)}
        envs.close()
        assert tasks == set(settings["tasks"])
        curriculum.flush()
        assert curriculum.stats()["counted"] + curriculum.stats()["stored"] == curriculum.stats()["flown"] > 10


def test_docking():
    settings = {**SETTINGS, "tasks": ["docking/multiagent"]}
    with local(settings=settings, form="groups", lease=4) as curriculum:
        envs = sparring.make_vec(num_envs=4, curriculum=curriculum)
        seen, _ = envs.reset()
        assert seen.shape == (4, 5, 8)
        ended = fly(envs, 1600, 1.0)
        envs.close()
        curriculum.flush()
        assert curriculum.stats()["flown"] == ended > 2


def test_a_server_that_dies_loses_nothing(tmp_path):
    db = tmp_path / "run.sqlite3"
    curriculum = local(db=db, form="groups", lease=64, ahead=300, patience_s=60)
    envs = sparring.make_vec(num_envs=16, curriculum=curriculum)
    envs.reset()
    fly(envs, 60)
    until(lambda: curriculum.stats()["ready"] >= 300)
    server = curriculum._server
    server._process.send_signal(signal.SIGKILL)
    server._process.wait()
    ended = fly(envs, 200)
    assert ended > 40
    away = curriculum.stats()
    assert away["away_s"] is not None
    assert away["waiting"] >= 40
    again = serve_again(db, curriculum.url)
    try:
        fly(envs, 100)
        envs.close()
        curriculum.flush()
        told = curriculum.stats()
        assert told["counted"] + told["stored"] + told["duplicate"] == told["flown"]
        assert told["late"] == 0
        curriculum.close()
    finally:
        again.terminate()
        again.wait()


def test_a_server_that_stays_away_is_told_and_what_was_flown_is_kept():
    curriculum = local(form="groups", lease=16, patience_s=0.5)
    envs = sparring.make_vec(num_envs=8, curriculum=curriculum)
    envs.reset()
    curriculum._server._process.kill()
    curriculum._server._process.wait()
    began = time.monotonic()
    with pytest.raises(sparring.CurriculumError, match="away"):
        fly(envs, 2000)
    assert time.monotonic() - began < 20
    assert curriculum.stats()["waiting"] == curriculum.stats()["flown"] > 0
    envs.close()
    with pytest.raises(sparring.CurriculumError, match="could not be handed in"):
        curriculum.close(timeout_s=1)


def test_what_the_server_refuses_is_told():
    with pytest.raises(sparring.CurriculumError, match="no server answers"):
        sparring.Curriculum("http://127.0.0.1:1", run="run-none")
    with local() as curriculum:
        with pytest.raises(sparring.CurriculumError, match="404"):
            sparring.Curriculum(curriculum.url, run="run-none")
        with pytest.raises(sparring.CurriculumError, match="tasks"):
            sparring.Curriculum(curriculum.url, settings={"tasks": ["none"]})
        with pytest.raises(ValueError, match="level"):
            sparring.make_vec(curriculum=curriculum, level=3)
        with pytest.raises(ValueError, match="task"):
            sparring.make_vec("kessler/formation", curriculum=curriculum)
        envs = sparring.make_vec(curriculum=curriculum)
        with pytest.raises(ValueError, match="scenario"):
            envs.reset(options={"scenario": sparring.Scenario("survival")})
    with pytest.raises(sparring.CurriculumError, match="closed"):
        envs.reset()


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


def test_a_program_that_is_none():
    with pytest.raises(sparring.CurriculumError, match="start"):
        sparring.Curriculum.local(binary="/nowhere/sparring")
    with pytest.raises(sparring.CurriculumError, match="serve"):
        sparring.Curriculum.local(binary="/bin/false")


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


def test_a_reset_that_fails_moves_nothing(tmp_path):
    db = tmp_path / "run.sqlite3"
    curriculum = local(db=db, form="groups", lease=16, ahead=8, patience_s=0.5)
    envs = sparring.make_vec(num_envs=16, curriculum=curriculum)
    envs.reset()
    fly(envs, 20)
    curriculum._server._process.kill()
    curriculum._server._process.wait()
    with pytest.raises(sparring.CurriculumError):
        fly(envs, 2000)
    for _ in range(3):
        with pytest.raises(sparring.CurriculumError):
            envs.reset()
    again = serve_again(db, curriculum.url)
    try:
        until(lambda: curriculum.stats()["away_s"] is None)
        until(lambda: curriculum.stats()["ready"] >= 16)
        fly(envs, 130)
        envs.close()
        curriculum.flush()
        told = curriculum.stats()
        assert told["counted"] + told["stored"] + told["duplicate"] == told["flown"] > 16
        curriculum.close()
    finally:
        again.terminate()
        again.wait()


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


@pytest.mark.parametrize(
    ("field", "value"), [("lease", 0), ("lease", 2000), ("ahead", -1), ("buffer", 2.5), ("ttl_s", True), ("group_size", "4")]
)
def test_numbers_that_are_none(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        local(**{field: value})


def test_during_placement_no_level_is_told():
    settings = {**SETTINGS, "placement": True}
    with local(settings=settings, form="groups") as curriculum:
        names = set(curriculum.numbers())
    assert "kessler/survival/success" not in names, "nothing was flown"
    assert "kessler/survival/params/debris" in names
    assert not {name for name in names if "level" in name or "mastery" in name}


def test_an_evaluation_is_of_the_world_of_the_run():
    settings = {"tasks": ["docking/single"], "placement": False, "design": {"designer": "off"}}
    with local(settings=settings, form="groups") as curriculum:

        def hold(seen):
            return np.zeros((len(seen), 1, 3), np.float32)

        with pytest.raises(ValueError, match="suite: kessler-heldout-v2 is of kessler/"):
            sparring.evaluate(curriculum, hold, suite="kessler-heldout-v2")
        with pytest.raises(ValueError, match="policy: blind_panel"):
            sparring.evaluate(curriculum, hold, policy="blind_panel")
        with pytest.raises(ValueError, match="autoreset_mode"):
            sparring.evaluate(curriculum, hold, autoreset_mode="disabled")
        found = sparring.evaluate(curriculum, hold, policy="hold", chance=False)
        assert {row["task"] for row in found.rows} <= {"all", "docking/single"}
        assert found.of("docking/single", "score", "all") is not None


def test_an_evaluation_whose_policy_fails_is_cancelled():
    def act(seen):
        raise RuntimeError("no policy")

    with local() as curriculum:
        with pytest.raises(RuntimeError, match="no policy"):
            sparring.evaluate(curriculum, act)
        told = curriculum.ask("GET", "/v1/evaluations")["evaluations"]
        assert [(one["state"], one["trouble"]) for one in told] == [("failed", "it was cancelled")]


def test_who_cuts_episodes_off_is_told_that_they_do_not_count():
    with local() as curriculum:
        env = gymnasium.make("sparring/Survival-v0", curriculum=curriculum, max_episode_steps=3)
        env.reset()
        for _ in range(3):
            env.step(np.zeros(env.action_space.shape, np.float32))
        with pytest.warns(UserWarning, match="left after 3 steps"):
            env.reset()
        env.close()


@pytest.mark.parametrize("version", [-1, 2.7, True, 2**70, "1"])
def test_a_version_that_is_none(version):
    with local() as curriculum:
        with pytest.raises(ValueError, match="policy_version"):
            curriculum.policy_version = version
        assert curriculum.policy_version == 0


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


def test_two_batches_share_one_curriculum_and_what_is_given_back_is_flown_again():
    with local(form="groups", lease=8, ahead=8) as curriculum:
        one, two = (sparring.make_vec(num_envs=4, curriculum=curriculum) for _ in range(2))
        one.reset()
        two.reset()
        given = {one.scenario(env).seed for env in range(4)}
        one.close()
        with pytest.raises(sparring.CurriculumError, match="closed"):
            one.step(np.zeros(one.action_space.shape, np.float32))
        three = sparring.make_vec(num_envs=4, curriculum=curriculum)
        three.reset()
        assert {three.scenario(env).seed for env in range(4)} == given
        three.close()
        two.close()


def test_closing_without_a_server_is_interrupted_and_says_what_is_lost(ctrl_c):
    curriculum = local(form="groups")
    envs = sparring.make_vec(num_envs=4, curriculum=curriculum)
    envs.reset()
    until(lambda: curriculum.stats()["ready"] >= 8)
    curriculum._server._process.kill()
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


def test_a_strategy_that_does_not_go_with_columns_is_flown_as_groups():
    with local(settings={**SETTINGS, "strategy": "plr"}) as curriculum:
        envs = sparring.make_vec(num_envs=256, curriculum=curriculum)
        envs.reset()
        assert fly(envs, 52) >= 256
        envs.close()
        curriculum.flush()
        told = curriculum.stats()
    assert told["counted"] + told["stored"] == told["flown"]


@pytest.mark.parametrize("token", ["é", "two words", "line\nbreak"])
def test_a_token_that_is_none_is_not_repeated(token):
    for made in (sparring.Curriculum, sparring.Client):
        with pytest.raises(ValueError, match="token: ") as told:
            made(token=token)
        assert token not in str(told.value)


@pytest.mark.parametrize("patience_s", [-1.0, float("nan"), float("inf")])
def test_a_patience_that_is_none(patience_s):
    with pytest.raises(ValueError, match="patience_s: "):
        local(patience_s=patience_s)
