"""TRL's GRPO with several environments by name, each with the tools of its world. Run by hand: make test-heavy"""

import contextlib
import inspect
import os
import sys
from pathlib import Path

import pytest
from conftest import BINARY, needs_server
from curriculum_servers import SETTINGS, read_episodes

pytest.importorskip("trl")
import torch
from transformers.utils import get_json_schema
from trl import GRPOConfig, GRPOTrainer

import sparring
import sparring.trl

sys.path.insert(0, os.fspath(Path(__file__).parents[3] / "examples"))
tiny_model = pytest.importorskip("tiny_model")

pytestmark = needs_server
torch.set_num_threads(1)


@pytest.fixture(scope="module")
def url():
    with sparring.Curriculum.local(binary=BINARY, settings=SETTINGS) as owner:
        yield owner.url


@contextlib.contextmanager
def open_factory(url, *tasks, group_size=4, **arguments):
    """Opens a run of some tasks and a factory of its environments."""
    settings = {**SETTINGS, "tasks": list(tasks), "group_size": group_size}
    with (
        sparring.Curriculum(url, settings=settings) as curriculum,
        sparring.trl.EnvironmentFactory(curriculum, group_size, **arguments) as factory,
    ):
        yield factory


@pytest.fixture
def envs(url):
    with open_factory(url, "kessler/survival") as survival, open_factory(url, "docking/single") as docking:
        yield sparring.trl.Environments({"survival": survival, "docking": docking})


def test_docking_tools_have_the_schemas_that_trl_needs(url):
    with open_factory(url, "docking/single") as factory:
        env = factory()
        public = {name for name, _ in inspect.getmembers(type(env), inspect.isfunction) if not name.startswith("_")}
        assert public == {"reset", "get_reward", "thrust", "coast"}
        thrust = get_json_schema(env.thrust)["function"]["parameters"]
        assert thrust["required"] == ["deputy_id", "thrust_x", "thrust_y", "thrust_z", "seconds"]
        assert [field["type"] for field in thrust["properties"].values()] == ["integer", "number", "number", "number", "integer"]
        assert get_json_schema(env.coast)["function"]["parameters"]["required"] == ["seconds"]


@pytest.mark.parametrize(("task", "work"), [("tasking/scanning", "scan"), ("tasking/imaging", "image")])
def test_tasking_group_runs_by_tools(url, task, work):
    with open_factory(url, task) as factory:
        assert "satellite" in factory.rows(1)[0]["prompt"][0]["content"]
        members = [factory() for _ in range(4)]
        public = {name for name, _ in inspect.getmembers(type(members[0]), inspect.isfunction) if not name.startswith("_")}
        assert public == {"reset", "get_reward", work, "charge", "downlink", "desaturate", "wait", "telemetry"}
        schema = get_json_schema(getattr(members[0], work))["function"]["parameters"]
        assert schema["required"] == ["satellite_id", "target"] if work == "image" else ["satellite_id"]
        texts = {member.reset(group_id="a", prompt=[]) for member in members}
        assert len(texts) == 1 and "Satellite 0 needs an action." in min(texts)
        assert "Second 120 of" in members[0].charge(0)
        with pytest.raises(ValueError, match="satellite_id"):
            members[0].charge(1)
        rewards = [member.get_reward() for member in members]
        factory.flush()
        assert all(member.over for member in members) and rewards == [member.score for member in members]
        scores = [episode["score"] for episode in read_episodes(factory.curriculum)]
        assert sorted(scores) == pytest.approx(sorted(rewards), abs=1e-6)


def test_docking_group_shares_a_scenario_and_scores_match(url):
    with open_factory(url, "docking/multiagent") as factory:
        members = [factory() for _ in range(4)]
        texts = {member.reset(group_id="a", prompt=[]) for member in members}
        assert len(texts) == 1 and "DOCKING: " in min(texts) and "Deputy 0 at (" in min(texts)
        before = members[0].scenario
        assert all(member.scenario == before for member in members)
        for field, call in {
            "deputy_id": {"deputy_id": 9},
            "thrust_y": {"thrust_y": "north"},
            "seconds": {"seconds": 0},
        }.items():
            with pytest.raises(ValueError, match=field):
                members[0].thrust(**{"deputy_id": 0, "thrust_x": 0, "thrust_y": 0, "thrust_z": 0, "seconds": 1, **call})
        assert "Second 30 of" in members[0].thrust(0, 0.3, -0.3, 5, 30)
        assert "Second 300 of" in members[1].coast(1000)
        rewards = [member.get_reward() for member in members]
        assert all(member.over for member in members)
        assert "The episode is over" in members[2]._describe()
        assert rewards[0] != rewards[1] == rewards[2]
        factory.flush()
        scores = [episode["score"] for episode in read_episodes(factory.curriculum)]
        assert sorted(scores) == pytest.approx(sorted(rewards), abs=1e-6)


def test_dataset_alternates_and_names_environments(envs):
    rows = list(envs.dataset({"survival": 4, "docking": 2}))
    assert [row["environment"] for row in rows] == ["survival", "docking", "survival", "survival", "docking", "survival"]
    assert len({row["group_id"] for row in rows}) == 6
    prompts = {row["environment"]: row["prompt"][0]["content"].strip() for row in rows}
    assert prompts == {"survival": sparring.trl.PROMPT, "docking": sparring.trl.DOCKING_PROMPT}
    (row,) = [row for row in envs.dataset(1, prompts={"docking": "Dock."}) if row["environment"] == "docking"]
    assert row["prompt"][0]["content"] == "Dock.\n\n"


def test_invalid_environments_are_named(url, envs):
    with pytest.raises(ValueError, match="survivl"):
        envs.dataset({"survivl": 1, "docking": 1})
    with pytest.raises(ValueError, match="none for survival"):
        envs.dataset({"docking": 1})
    with pytest.raises(ValueError, match="prompts"):
        envs.dataset(1, prompts={"formation": "Fly."})
    with pytest.raises(ValueError, match="factories"):
        sparring.trl.Environments({})
    with open_factory(url, "kessler/formation", group_size=2) as other, pytest.raises(ValueError, match="num_generations"):
        sparring.trl.Environments({**envs, "formation": other})


def test_close_closes_all_factories(url):
    with open_factory(url, "kessler/survival") as one, open_factory(url, "docking/single") as two:
        with sparring.trl.Environments({"one": one, "two": two}) as envs:
            for factory in envs.values():
                factory().reset(group_id="a")
        for factory in (one, two):
            with pytest.raises(sparring.CurriculumError, match="closed"):
                factory().reset(group_id="b")


def test_trainer_offers_each_prompt_the_tools_of_its_environment(envs, tmp_path):
    tools = [tool for env in (envs["survival"](), envs["docking"]()) for tool in env_tools(env)]
    answers = [
        tiny_model.tool_call("hold", steps=20),
        tiny_model.tool_call("fire_thrusters", satellite_id=0, delta_vx=0.5, delta_vy=0.5),
        tiny_model.tool_call("coast", seconds=300),
        tiny_model.tool_call("thrust", deputy_id=0, thrust_x=0.5, thrust_y=0, thrust_z=0, seconds=60),
        {"content": "Done."},
    ]
    prompts = [sparring.trl.PROMPT, sparring.trl.DOCKING_PROMPT]
    model, tokenizer = tiny_model.make_tiny_model(prompts, answers, tools)
    tiny_model.teach(model, tokenizer, prompts, answers, tools)
    generated = []
    generate = model.generate

    def record(*arguments, input_ids, **keywords):
        generated.extend(tokenizer.batch_decode(input_ids))
        return generate(*arguments, input_ids=input_ids, **keywords)

    model.generate = record
    config = GRPOConfig(
        output_dir=os.fspath(tmp_path), use_cpu=True, bf16=False, max_steps=2, num_generations=4, per_device_train_batch_size=8,
        max_completion_length=1024, logging_steps=1, report_to="none", save_strategy="no", disable_tqdm=True, seed=1,
    )  # fmt: skip
    trainer = GRPOTrainer(
        model=model,
        processing_class=tokenizer,
        args=config,
        train_dataset=envs.dataset(2),
        environment_factory=envs,
        callbacks=[sparring.trl.CurriculumCallback(envs)],
    )
    trainer.train()
    envs.flush()
    first = [prompt for prompt in generated if prompt.count("<|im_start|>assistant\n") == 1]
    survival = [prompt for prompt in first if "SURVIVAL: " in prompt]
    docking = [prompt for prompt in first if "DOCKING: " in prompt]
    assert len(survival) == len(docking) == 8 and len(first) == 16
    assert all("Step 0." in prompt and '"fire_thrusters"' in prompt and '"coast"' not in prompt for prompt in survival)
    assert all("Deputy 0 at (" in prompt and '"coast"' in prompt and '"fire_thrusters"' not in prompt for prompt in docking)
    for name, factory in envs.items():
        episodes = read_episodes(factory.curriculum)
        scenarios = [episode["scenario_id"] for episode in episodes]
        assert sorted(map(scenarios.count, set(scenarios))) == [4, 4], name
        assert factory.stats()["finished"] == 8
    logged = trainer.state.log_history[1]
    assert {"rewards/ToolEnvironment/mean", "rewards/DockingEnvironment/mean"} <= set(logged)
    assert logged["curriculum/survival/episodes/finished"] == logged["curriculum/docking/episodes/finished"] == 8
    assert "curriculum/docking/docking/single/level" in logged


def env_tools(env):
    """Returns the tools of an environment, as TRL finds them."""
    names = [name for name, _ in inspect.getmembers(type(env), inspect.isfunction)]
    return [getattr(env, name) for name in names if not name.startswith("_") and name not in ("reset", "get_reward")]
