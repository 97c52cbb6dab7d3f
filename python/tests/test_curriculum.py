"""A curriculum of a real server: what is flown by it, and what is refused."""

import os
import subprocess
import sysconfig

import gymnasium
import numpy as np
import pytest
from conftest import BINARY, served
from flights import SETTINGS, fly, local, until

import sparring

pytestmark = served


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
        with pytest.raises(ValueError, match="options"):
            envs.reset(options={"scenario": sparring.Scenario("survival")})
    with pytest.raises(sparring.CurriculumError, match="closed"):
        envs.reset()


def test_the_program_is_found_beside_the_python_that_runs(tmp_path, monkeypatch):
    """In an environment that was not activated, too."""
    monkeypatch.delenv("SPARRING_BIN", raising=False)
    monkeypatch.setattr(sysconfig, "get_path", lambda scheme: os.fspath(tmp_path) if scheme == "scripts" else None)
    monkeypatch.setenv("PATH", os.defpath)
    with pytest.raises(sparring.CurriculumError, match="pip install sparring-server"):
        sparring.Curriculum.local()
    (tmp_path / "sparring").symlink_to(BINARY)
    with sparring.Curriculum.local(settings=SETTINGS) as curriculum:
        assert repr(curriculum) == f"Curriculum({curriculum.url!r}, run={curriculum.run!r})"
        assert curriculum.numbers()


def test_a_program_that_is_none():
    with pytest.raises(sparring.CurriculumError, match="start"):
        sparring.Curriculum.local(binary="/nowhere/sparring")
    with pytest.raises(sparring.CurriculumError, match="serve"):
        sparring.Curriculum.local(binary="/bin/false")


WRONG = {
    "lease": [0, 2000],
    "ahead": [-1],
    "buffer": [2.5],
    "ttl_s": [True],
    "group_size": ["4"],
    "patience_s": ["5", None],
    "run": [3, ""],
    "url": ["127.0.0.1:8700", None],
    "token": [3],
    "settings": [[1], {"tasks": {1}}, {"group_size": float("nan")}],
}


@pytest.mark.parametrize(("field", "value"), [(field, value) for field, values in WRONG.items() for value in values], ids=str)
def test_what_is_none_is_named(field, value):
    with pytest.raises(ValueError, match=f"^{field}: "):
        sparring.Curriculum(**{"url": "http://127.0.0.1:1", field: value})


def test_a_database_that_has_tokens_is_asked_with_one(tmp_path, monkeypatch):
    db = tmp_path / "run.sqlite3"
    monkeypatch.setenv("SPARRING_TOKEN", "sparring_1_of_another")
    with local(db=db) as curriculum:
        assert curriculum.token is None
    line = [BINARY, "token", "create", "mine", "--role", "admin", "--db", os.fspath(db)]
    told = subprocess.run(line, capture_output=True, text=True, check=True).stdout.split()
    monkeypatch.setenv("SPARRING_TOKEN", next(word for word in told if word.startswith("sparring_")))
    with local(db=db) as curriculum:
        assert curriculum.beside().run == curriculum.run
    monkeypatch.delenv("SPARRING_TOKEN")
    with pytest.raises(sparring.CurriculumError, match="401"):
        local(db=db)


def test_a_server_on_this_machine_needs_no_proxy_and_no_token_of_another(monkeypatch):
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
    monkeypatch.setenv("SPARRING_TOKEN", "sparring_1_of_another")
    with local(form="groups") as curriculum, sparring.Client(curriculum.url, token="") as client:
        envs = sparring.make_vec(num_envs=4, curriculum=curriculum)
        envs.reset()
        assert fly(envs, 60) >= 4
        envs.close()
        curriculum.flush()
        assert curriculum.beside().run == curriculum.run == client.runs.list()["runs"][0]["id"]
        with pytest.raises(sparring.CurriculumError, match="401"):
            sparring.Curriculum(curriculum.url, curriculum.run)


def test_a_server_is_found_or_started(monkeypatch):
    monkeypatch.setenv("SPARRING_BIN", BINARY)
    with sparring.Curriculum.find(settings=SETTINGS) as started:
        found = sparring.Curriculum.find(started.url, started.run, settings=SETTINGS, form="groups")
        assert (found.url, found.run) == (started.url, started.run)
        assert sparring.Curriculum.find(started.url, settings=SETTINGS).run != started.run
    with pytest.raises(ValueError, match=r"^run: "):
        sparring.Curriculum.find(run="mine")


@pytest.mark.parametrize("form", ["groups", "columns"])
def test_groups_may_be_as_large_as_a_run_takes(form):
    with local(settings={**SETTINGS, "group_size": 1024}, form=form) as curriculum:
        envs = sparring.make_vec(num_envs=4, curriculum=curriculum)
        envs.reset()
        assert curriculum.stats()["ready"] > 1024
        envs.close()


def test_parts_of_a_run_are_as_patient():
    with local(patience_s=1.5) as curriculum:
        assert curriculum.beside()._wish["patience_s"] == 1.5
        assert curriculum.beside(patience_s=3)._wish["patience_s"] == 3.0


def test_settings_may_have_numbers_of_numpy():
    with local(settings={**SETTINGS, "group_size": np.int64(4)}) as curriculum:
        assert curriculum.ask("GET", f"/v1/runs/{curriculum.run}")["settings"]["group_size"] == 4


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


def test_episodes_are_by_the_policy_that_began_them():
    with local(form="groups", lease=8) as curriculum:
        envs = sparring.make_vec(num_envs=4, curriculum=curriculum)
        envs.reset()
        fly(envs, 5)
        curriculum.policy_version = 7
        assert fly(envs, 120) >= 8
        envs.close()
        curriculum.flush()
        page = curriculum.ask("GET", f"/v1/runs/{curriculum.run}/episodes?limit=100")
        versions = [episode["policy_version"] for episode in page["episodes"]]
        assert versions.count(0) == 4
        assert set(versions) == {0, 7}
        # Who joins the run later counts on from there.
        assert sparring.Curriculum(curriculum.url, curriculum.run).policy_version == 7


def test_a_run_that_turns_to_single_scenarios_goes_on_as_groups():
    with local() as curriculum:
        envs = sparring.make_vec(num_envs=256, curriculum=curriculum)
        envs.reset()
        assert curriculum.ask("GET", f"/v1/runs/{curriculum.run}/leases")["leases"][0]["form"] == "columns"
        curriculum.ask("PATCH", f"/v1/runs/{curriculum.run}", {"strategy": "plr"})
        assert fly(envs, 320, 0.02) > 1000
        envs.close()
        curriculum.flush()
        told = curriculum.stats()
        assert told["counted"] + told["stored"] > 0
        assert told["fault"] is None


def test_a_buffer_that_is_smaller_than_a_lease_holds_nobody_up():
    with local(form="columns", lease=64, buffer=16, patience_s=20) as curriculum:
        envs = sparring.make_vec(num_envs=32, curriculum=curriculum)
        envs.reset()
        assert fly(envs, 320, 0.02) > 150
        envs.close()
        curriculum.flush()
        assert curriculum.stats()["accepted"] >= 64


def exam(curriculum):
    begun = curriculum.ask("POST", "/v1/evaluations", {"run": curriculum.run, "policy": "hold", "tasks": ["kessler/survival"]})
    return begun["scenarios"] * begun["rollouts"], curriculum.beside(purpose="eval", evaluation=begun["id"])


def test_a_reset_amid_an_evaluation_leaves_no_scenario_out():
    with local() as curriculum:
        most, part = exam(curriculum)
        with part:
            envs = sparring.make_vec(num_envs=64, curriculum=part)
            envs.reset()
            ended = 0
            while not envs.rests.all():
                *_, infos = envs.step(np.zeros(envs.action_space.shape, np.float32))
                if "_episode" in infos:
                    ended += int(infos["_episode"].sum())
                    # Nothing is left but what flies: all of that begins again, twice.
                    if part.stats()["ready"] == 0 and most - 8 < ended < most - 4:
                        envs.reset()
                        assert not envs.rests.all()
                        assert (envs.rests.sum()) == 64 - (most - ended)
            envs.close()
            assert ended == most
            with pytest.raises(sparring.CurriculumError, match="nothing to fly: the evaluation is flown"):
                sparring.make_vec(curriculum=part)


def test_who_begins_the_last_scenario_again_flies_it():
    with local() as curriculum:
        most, part = exam(curriculum)
        with part:
            for env, agents in ((sparring.Environment(curriculum=part), False), (sparring.parallel_env(curriculum=part), True)):
                flown = 0
                while flown < (most // 2 if not agents else most - most // 2):
                    env.reset()
                    hold(env)
                    flown += 1
                if agents:
                    with pytest.raises(sparring.CurriculumError, match="nothing left to fly"):
                        env.reset()
                env.close()
            told = part.stats()
            assert told["flown"] == most


def hold(env):
    """Flies an episode by doing nothing."""
    if isinstance(env, gymnasium.Env):
        over = False
        while not over:
            *_, terminated, truncated, _ = env.step(np.zeros(env.action_space.shape, np.float32))
            over = terminated or truncated
    else:
        while env.agents:
            env.step({})


def test_who_leaves_agents_early_is_told_too():
    with local(form="groups") as curriculum:
        env = sparring.parallel_env(curriculum=curriculum)
        env.reset()
        env.step({})
        with pytest.warns(UserWarning, match="left after 1 steps"):
            env.reset()
        env.close()


def test_what_is_given_up_is_given_back_when_its_lease_is_done():
    with local(form="groups", lease=1, settings={**SETTINGS, "group_size": 2}) as curriculum:
        env = sparring.Environment(curriculum=curriculum)
        env.reset()
        first = env.scenario
        env._abandon()
        env.reset()
        assert env.scenario == first, "its sibling"
        hold(env)
        until(lambda: curriculum.ask("GET", f"/v1/runs/{curriculum.run}/leases?limit=100")["leases"][0]["status"] == "released")
        assert curriculum.stats()["unflown"] == 1
        env.close()
