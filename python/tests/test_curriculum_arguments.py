"""Arguments of a curriculum: servers, tokens and values that are rejected."""

import os
import pickle
import subprocess
import sysconfig

import numpy as np
import pytest
from conftest import BINARY, needs_server
from curriculum_servers import SETTINGS, local_curriculum, step_randomly

import sparring

pytestmark = needs_server

INVALID = {
    "lease_groups": [0, 2000],
    "ahead": [-1],
    "buffer": [2.5],
    "ttl_s": [True],
    "group_size": ["4"],
    "max_wait_s": ["5", None],
    "run": [3, ""],
    "url": ["127.0.0.1:8700", None],
    "token": [3],
    "settings": [[1], {"tasks": {1}}, {"group_size": float("nan")}],
}


@pytest.mark.parametrize(("field", "value"), [(field, value) for field, values in INVALID.items() for value in values], ids=str)
def test_invalid_argument_is_named(field, value):
    with pytest.raises(ValueError, match=f"^`{field}` must "):
        sparring.Curriculum(**{"url": "http://127.0.0.1:1", field: value})


@pytest.mark.parametrize("max_wait_s", [-1.0, float("nan"), float("inf")])
def test_invalid_max_wait_is_rejected(max_wait_s):
    with pytest.raises(ValueError, match="`max_wait_s` must "):
        local_curriculum(max_wait_s=max_wait_s)


@pytest.mark.parametrize("version", [-1, 2.7, True, 2**70, "1"])
def test_invalid_policy_version_is_rejected(version):
    with local_curriculum() as curriculum:
        with pytest.raises(ValueError, match="policy_version"):
            curriculum.policy_version = version
        assert curriculum.policy_version == 0


@pytest.mark.parametrize("token", ["é", "two words", "line\nbreak"])
def test_invalid_token_is_not_repeated(token):
    for make in (sparring.Curriculum, sparring.Client):
        with pytest.raises(ValueError, match="`token` must ") as error:
            make(token=token)
        assert token not in str(error.value)


def test_rejection_of_the_server_is_raised():
    with pytest.raises(sparring.CurriculumError, match="no server answers"):
        sparring.Curriculum("http://127.0.0.1:1", run="run-none")
    with local_curriculum() as curriculum:
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


def test_settings_may_have_numpy_numbers():
    with local_curriculum(settings={**SETTINGS, "group_size": np.int64(4)}) as curriculum:
        assert curriculum.request("GET", f"/v1/runs/{curriculum.run}")["settings"]["group_size"] == 4


def test_reopened_curriculum_has_the_same_max_wait():
    with local_curriculum(max_wait_s=1.5) as curriculum:
        assert curriculum.reopen()._lease_settings["max_wait_s"] == 1.5
        assert curriculum.reopen(max_wait_s=3)._lease_settings["max_wait_s"] == 3.0


def test_pickled_curriculum_opens_the_same_run(tmp_path, monkeypatch):
    db = tmp_path / "run.sqlite3"
    with local_curriculum(db=db, form="columns", lease_groups=3, max_wait_s=1.5, ttl_s=20) as curriculum:
        monkeypatch.setenv("SPARRING_TOKEN", "sparring_1_of_another")
        with pickle.loads(pickle.dumps(curriculum)) as loaded:
            assert (loaded.url, loaded.run, loaded.token) == (curriculum.url, curriculum.run, None)
            assert (loaded._form, loaded._lease_groups) == ("columns", 3)
            assert loaded._lease_settings == curriculum._lease_settings
    command = [BINARY, "token", "create", "mine", "--role", "trainer", "--db", os.fspath(db)]
    token = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    with local_curriculum(db=db, token=token) as curriculum:
        pickled = pickle.dumps(curriculum)
        assert token.encode() not in pickled
        with pytest.raises(sparring.CurriculumError, match="401"):
            pickle.loads(pickled)
        monkeypatch.setenv("SPARRING_TOKEN", token)
        pickle.loads(pickled).close()


def test_program_is_found_beside_python(tmp_path, monkeypatch):
    """The search needs no activated environment."""
    monkeypatch.delenv("SPARRING_BIN", raising=False)
    monkeypatch.setattr(sysconfig, "get_path", lambda scheme: os.fspath(tmp_path) if scheme == "scripts" else None)
    monkeypatch.setenv("PATH", os.defpath)
    with pytest.raises(sparring.CurriculumError, match="pip install sparring-server"):
        sparring.Curriculum.local()
    (tmp_path / "sparring").symlink_to(BINARY)
    with sparring.Curriculum.local(settings=SETTINGS) as curriculum:
        assert repr(curriculum) == f"Curriculum({curriculum.url!r}, run={curriculum.run!r})"
        assert curriculum.metrics()


def test_settings_do_not_go_with_a_run():
    with local_curriculum() as curriculum:
        with pytest.raises(ValueError, match=f"^`settings` must be omitted with `run`: '{curriculum.run}' exists and keeps its"):
            sparring.Curriculum(curriculum.url, curriculum.run, settings=SETTINGS)
        missing = r"'ledger' does not exist; to create it, pass settings={'id': 'ledger', …} without `run`$"
        with pytest.raises(ValueError, match=f"^`settings` must be omitted with `run`: {missing}"):
            sparring.Curriculum(curriculum.url, run="ledger", settings=SETTINGS)
        with pytest.raises(sparring.CurriculumError, match=r"404.*ledger"):
            sparring.Curriculum(curriculum.url, run="ledger")
        with sparring.Curriculum(curriculum.url, settings={**SETTINGS, "id": "ledger"}) as created:
            assert created.run == "ledger"
    with pytest.raises(sparring.CurriculumError, match="no server answers"):
        sparring.Curriculum("http://127.0.0.1:1", run="ledger", settings=SETTINGS)


def test_failing_program_is_reported():
    with pytest.raises(sparring.CurriculumError, match="start"):
        sparring.Curriculum.local(binary="/nowhere/sparring")
    with pytest.raises(sparring.CurriculumError, match="serve"):
        sparring.Curriculum.local(binary="/bin/false")


def test_database_with_tokens_needs_a_token(tmp_path, monkeypatch):
    db = tmp_path / "run.sqlite3"
    monkeypatch.setenv("SPARRING_TOKEN", "sparring_1_of_another")
    with local_curriculum(db=db) as curriculum:
        assert curriculum.token is None
    command = [BINARY, "token", "create", "mine", "--role", "admin", "--db", os.fspath(db)]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    monkeypatch.setenv("SPARRING_TOKEN", next(word for word in output if word.startswith("sparring_")))
    with local_curriculum(db=db) as curriculum:
        assert curriculum.reopen().run == curriculum.run
    monkeypatch.delenv("SPARRING_TOKEN")
    with pytest.raises(sparring.CurriculumError, match="401"):
        local_curriculum(db=db)


def test_local_server_ignores_proxy_and_foreign_token(monkeypatch):
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
    monkeypatch.setenv("SPARRING_TOKEN", "sparring_1_of_another")
    with local_curriculum(form="groups") as curriculum, sparring.Client(curriculum.url, token="") as client:
        envs = sparring.make_vec(num_envs=4, curriculum=curriculum)
        envs.reset()
        assert step_randomly(envs, 60) >= 4
        envs.close()
        curriculum.flush()
        assert curriculum.reopen().run == curriculum.run == client.runs.list()["runs"][0]["id"]
        with pytest.raises(sparring.CurriculumError, match="401"):
            sparring.Curriculum(curriculum.url, curriculum.run)


def test_open_connects_or_starts_a_server(monkeypatch):
    monkeypatch.setenv("SPARRING_BIN", BINARY)
    with sparring.Curriculum.open(settings=SETTINGS) as started:
        connected = sparring.Curriculum.open(started.url, started.run, settings=SETTINGS, form="groups")
        assert (connected.url, connected.run) == (started.url, started.run)
        assert sparring.Curriculum.open(started.url, settings=SETTINGS).run != started.run
    with pytest.raises(ValueError, match=r"^`run` must "):
        sparring.Curriculum.open(run="mine")
