"""TRL's GRPO with the curriculum of a real server, with tiny models. Run by hand:

    scripts/heavy-venv
    cd python && SPARRING_BINARY=../target/debug/sparring PYTHONPATH=. ../target/heavy-venv/bin/pytest -o addopts= \
        -o filterwarnings=default -p no:cacheprovider tests/heavy/test_trl.py
"""

import inspect
import json
import os
import sys
from pathlib import Path

import pytest
from conftest import BINARY, needs_server
from curriculum_servers import SETTINGS, read_episodes
from documents import printed_command, run_command

pytest.importorskip("trl")
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from transformers.utils import get_json_schema
from trl import GRPOConfig, GRPOTrainer

import sparring
import sparring.trl

EXAMPLES = Path(__file__).parents[3] / "examples"
sys.path.insert(0, os.fspath(EXAMPLES))
tiny_model = pytest.importorskip("tiny_model")

pytestmark = needs_server
torch.set_num_threads(1)


def local_curriculum(group_size=4, **settings):
    return sparring.Curriculum.local(binary=BINARY, settings={**SETTINGS, "group_size": group_size, **settings})


@pytest.fixture(scope="module")
def curriculum():
    with local_curriculum() as opened:
        yield opened


@pytest.fixture
def envs(curriculum):
    with sparring.trl.EnvironmentFactory(curriculum, 4) as factory:
        yield factory


def first_prompts(count):
    """Returns the prompts at the beginning of some scenarios."""
    env = sparring.Environment("kessler/survival")
    texts = []
    for seed in range(count):
        env.reset(seed=seed)
        texts.append(f"{env.telemetry()['mission_objective']}\nStep 0.\n{sparring.trl.describe_telemetry(env.telemetry())}")
    return [f"{sparring.trl.PROMPT}\n\n{text}" for text in texts]


def make_config(folder, group_size=4, groups=1, **more):
    settings = {
        "output_dir": os.fspath(folder),
        "use_cpu": True,
        "bf16": False,
        "max_steps": 2,
        "num_generations": group_size,
        "per_device_train_batch_size": group_size,
        "gradient_accumulation_steps": groups,
        "max_completion_length": 64,
        "logging_steps": 1,
        "report_to": "tensorboard",
        "save_strategy": "no",
        "disable_tqdm": True,
        "seed": 1,
    }
    return GRPOConfig(**{**settings, **more})


def train(envs, model, tokenizer, config, groups=2, **more):
    trainer = GRPOTrainer(
        model=model,
        processing_class=tokenizer,
        args=config,
        train_dataset=envs.dataset(groups),
        environment_factory=envs,
        callbacks=[sparring.trl.CurriculumCallback(envs)],
        **more,
    )
    trainer.train()
    return trainer


def test_tools_have_the_schemas_that_trl_needs(envs):
    env = envs()
    schemas = {tool.__name__: get_json_schema(tool)["function"] for tool in (env.fire_thrusters, env.hold, env.telemetry)}
    burn = schemas["fire_thrusters"]["parameters"]
    assert {name: field["type"] for name, field in burn["properties"].items()} == {
        "satellite_id": "integer",
        "delta_vx": "number",
        "delta_vy": "number",
    }
    assert burn["required"] == ["satellite_id", "delta_vx", "delta_vy"]
    assert all(field["description"] for field in burn["properties"].values())
    assert schemas["hold"]["parameters"]["required"] == ["steps"]
    assert schemas["telemetry"]["parameters"]["properties"] == {}
    public = {name for name, _ in inspect.getmembers(type(env), inspect.isfunction) if not name.startswith("_")}
    # TRL offers every public method as a tool.
    assert public == {"reset", "get_reward", *schemas}


def test_group_shares_a_scenario_and_server_scores_match(curriculum):
    with sparring.trl.EnvironmentFactory(curriculum, 4) as envs:
        members = [envs() for _ in range(8)]
        # Two groups at once, their members in any order.
        scenarios_by_group = {}
        for member, group in zip(members, "abbaabab", strict=True):
            text = member.reset(prompt=[], group_id=group)
            assert "SURVIVAL" in text and "Satellite 2" in text
            scenarios_by_group.setdefault(group, set()).add(member.scenario)
        assert len(scenarios_by_group["a"]) == len(scenarios_by_group["b"]) == 1
        assert scenarios_by_group["a"] != scenarios_by_group["b"]
        members[0].hold(50)
        with pytest.raises(ValueError, match="over"):
            members[0].hold(1)
        for _ in range(12):
            if not members[1].over:
                members[1].fire_thrusters(0, 0.3, 0.3)
        assert members[2].telemetry() == members[2].telemetry()
        rewards = [member.get_reward() for member in members]
        assert rewards == [member.get_reward() for member in members]
        assert all(member.over for member in members)
        scenarios = [member.scenario for member in members]
        text = members[0].reset(group_id="a")
        assert "Step 0." in text
        assert members[0].scenario != scenarios[0]
        envs.flush()
        stats = envs.stats()
    assert stats["finished"] == stats["counted"] + stats["stored"] == 8
    episodes = read_episodes(curriculum)
    assert [episode["scenario_id"] for episode in episodes].count(scenarios[0].id) == 4
    expected = sorted((scenario.id, reward) for scenario, reward in zip(scenarios, rewards, strict=True))
    scored = sorted((episode["scenario_id"], episode["score"]) for episode in episodes)
    assert [id for id, _ in scored] == [id for id, _ in expected]
    assert [score for _, score in scored] == pytest.approx([reward for _, reward in expected], abs=1e-6)


def test_skill_reward_equals_the_brackets(curriculum):
    with sparring.trl.EnvironmentFactory(curriculum, 4, reward="skill") as envs:
        members = [envs() for _ in range(4)]
        for member in members:
            member.reset()
        reward = members[0].get_reward()
        bracket = sparring.bracket(members[0].scenario)
        assert reward == pytest.approx(bracket.skill(members[0].score) or 0.0)
        assert members[0].score == pytest.approx(bracket.hold, abs=1e-6)


def test_measured_group_has_zero_reward():
    with local_curriculum(strategy="plr_robust") as curriculum, sparring.trl.EnvironmentFactory(curriculum, 4) as envs:
        members = [envs() for _ in range(4)]
        for member in members:
            member.reset(group_id="a")
        members[0].fire_thrusters(0, 1.0, 1.0)
        assert [member.get_reward() for member in members] == [0.0] * 4
        assert all(member.score > 0 for member in members)
        envs.flush()
        assert envs.stats()["finished"] == 4


def test_unfinished_group_is_released(curriculum):
    with sparring.trl.EnvironmentFactory(curriculum, 4) as envs:
        members = [envs() for _ in range(4)]
        for member in members:
            member.reset(group_id="a")
        members[0].get_reward()
        unfinished = members[0].scenario
        # A training stops in the middle of a group, and another one begins.
        for member in members:
            member.reset(group_id="b")
        assert len({member.scenario for member in members}) == 1
        assert members[0].scenario != unfinished
        for member in members:
            member.get_reward()
        last = members[0].scenario
        # Another environment takes an episode of a group; the next group is still complete.
        other = sparring.Environment(curriculum=envs._group_curriculum)
        other.reset()
        for member in members:
            member.reset(group_id="c")
        assert len({member.scenario for member in members}) == 1
        assert other.scenario not in {member.scenario for member in members}
        for member in members:
            member.get_reward()
        envs.flush()
        assert envs.stats()["finished"] == 9
    path = f"/v1/runs/{curriculum.run}/leases"
    rows = curriculum.request("GET", f"{path}?limit=500")["leases"]
    leases = [curriculum.request("GET", f"{path}/{row['lease']}") for row in rows]
    ended = {group["scenario"]: (lease["status"], group["state"]) for lease in leases for group in lease["groups"]}
    assert ended[unfinished.id] == ("released", "lost")
    assert ended[last.id] == ended[members[0].scenario.id] == ("done", "complete")


def test_invalid_tool_call_changes_nothing(envs):
    member = envs()
    with pytest.raises(Exception, match="reset"):
        member.hold(1)
    member.reset()
    before = member.telemetry()
    for invalid in ({"satellite_id": 3}, {"satellite_id": "a"}, {"delta_vx": "much"}, {"delta_vy": float("nan")}):
        with pytest.raises(ValueError, match=next(iter(invalid))):
            member.fire_thrusters(**{"satellite_id": 0, "delta_vx": 0.1, "delta_vy": 0.1, **invalid})
    with pytest.raises(ValueError, match="steps"):
        member.hold(0)
    assert member.telemetry() == before
    member.fire_thrusters(0, 1e300, "0.5")
    assert "Step 1." in member.telemetry()


def test_invalid_setting_is_named(curriculum, envs, tmp_path):
    with pytest.raises(ValueError, match="reward"):
        sparring.trl.EnvironmentFactory(curriculum, 4, reward="luck")
    with pytest.raises(ValueError, match="group_size"):
        sparring.trl.EnvironmentFactory(curriculum, 0)
    with (
        local_curriculum(tasks=["kessler/survival", "docking/single"]) as other,
        pytest.raises(ValueError, match="docking/single"),
    ):
        sparring.trl.EnvironmentFactory(other, 4)
    callback = sparring.trl.CurriculumCallback(envs)
    for settings, field in (
        ({"group_size": 2}, "num_generations"),
        ({"per_device_train_batch_size": 2, "groups": 3, "generation_batch_size": 12}, None),
        ({"per_device_train_batch_size": 2, "gradient_accumulation_steps": 2}, None),
        ({"eval_strategy": "steps", "eval_steps": 1, "per_device_eval_batch_size": 4}, "eval_strategy"),
    ):
        args = make_config(tmp_path, **settings)
        if field is None:
            args.steps_per_generation = 3 if "groups" in settings else 1
            field = "per_device_train_batch_size"
        with pytest.raises(ValueError, match=field):
            callback.on_train_begin(args, None, None)


def test_random_model_trains_for_two_steps(tmp_path):
    with local_curriculum() as curriculum, sparring.trl.EnvironmentFactory(curriculum, 4) as envs:
        model, tokenizer = tiny_model.make_tiny_model([sparring.trl.PROMPT])
        trainer = train(envs, model, tokenizer, make_config(tmp_path, groups=2), groups=4)
        envs.flush()
        stats = envs.stats()
        # The model calls no tool, so all episodes of a group hold and have the same score.
        assert trainer.state.global_step == 2
        assert stats["finished"] == stats["counted"] + stats["stored"] == 2 * 2 * 4
        for row in trainer.state.log_history[:2]:
            assert row["tools/call_frequency"] == 0
            assert row["reward_std"] == pytest.approx(0.0, abs=1e-6) or row["frac_reward_zero_std"] == 1.0
            assert row["curriculum/kessler/survival/zero_variance_share"] == 1.0
        logged = curriculum.request("GET", f"/v1/runs/{curriculum.run}/metrics")["metrics"]
        assert {"loss", "reward", "entropy"} <= {curve["name"] for curve in logged}
        assert not any(curve["name"].startswith("curriculum") for curve in logged)
        assert max(step for curve in logged for step in curve["step"]) == 2
        episodes = read_episodes(curriculum)
        assert len(episodes) == 16
        assert len({episode["scenario_id"] for episode in episodes}) == 4


def test_model_that_calls_tools_learns(tmp_path):
    with local_curriculum(group_size=8) as curriculum, sparring.trl.EnvironmentFactory(curriculum, 8) as envs:
        tools = [envs().fire_thrusters, envs().hold, envs().telemetry]
        burns = [tiny_model.tool_call("fire_thrusters", satellite_id=n, delta_vx=0.9, delta_vy=-0.9) for n in range(3)]
        answers = [*burns, tiny_model.tool_call("hold", steps=5), tiny_model.tool_call("telemetry"), {"content": "Done."}]
        prompts = first_prompts(8)
        model, tokenizer = tiny_model.make_tiny_model(prompts, answers, tools)
        tiny_model.teach(model, tokenizer, prompts, answers, tools)
        before = {name: weight.detach().clone() for name, weight in model.named_parameters()}
        config = make_config(tmp_path, group_size=8, groups=2, max_completion_length=1024, learning_rate=1e-4)
        trainer = train(envs, model, tokenizer, config, groups=4)
        envs.flush()
        stats = envs.stats()
        logged = [row for row in trainer.state.log_history if "tools/call_frequency" in row]
        print(json.dumps(logged, indent=1))
        assert len(logged) == 2
        assert all(row["tools/call_frequency"] > 0.5 for row in logged)
        assert all(row["tools/failure_frequency"] < 0.5 for row in logged)
        assert stats["finished"] == stats["counted"] + stats["stored"] == 2 * 2 * 8
        episodes = read_episodes(curriculum)
        groups = {}
        for episode in episodes:
            groups.setdefault(episode["scenario_id"], []).append(episode)
        assert sorted(map(len, groups.values())) == [8, 8, 8, 8]
        # Some episodes have burns and some have none, so scores differ and weights change.
        has_burns = [any(episode["actions"]["steps"]) for episode in episodes]
        assert any(has_burns) and not all(has_burns)
        assert any(len({episode["score"] for episode in group}) > 1 for group in groups.values())
        change = max(float((weight - before[name]).abs().max()) for name, weight in model.named_parameters())
        assert change > 0
        # The second step has the next policy version.
        assert {episode["policy_version"] for episode in episodes} == {0, 1}
        assert curriculum.mastery()[0]["results"]["episodes"] == 32
    events = EventAccumulator(os.fspath(tmp_path / "runs" / "curriculum"))
    events.Reload()
    tags = set(events.Tags()["scalars"])
    for name in ("level", "mastery", "success", "skill", "score", "zero_variance_share", "params/debris"):
        assert f"curriculum/kessler/survival/{name}" in tags or name == "skill", name
    assert [event.step for event in events.Scalars("curriculum/kessler/survival/level")][:2] == [1, 2]
    assert events.Scalars("curriculum/episodes/finished")[-1].value == 32
    assert "curriculum/kessler/survival/mastery" in trainer.state.log_history[0]


def test_mission_and_observation_reach_the_prompt(envs, tmp_path):
    model, tokenizer = tiny_model.make_tiny_model([sparring.trl.PROMPT])
    prompts, generate = [], model.generate

    def record(*arguments, input_ids, **keywords):
        prompts.extend(tokenizer.batch_decode(input_ids))
        return generate(*arguments, input_ids=input_ids, **keywords)

    model.generate = record
    train(envs, model, tokenizer, make_config(tmp_path, groups=2, max_steps=1))
    assert len(prompts) == 8
    for prompt in prompts:
        system, user = prompt.split("<|im_start|>user\n")
        assert "fire_thrusters" in system
        assert user.startswith(f"{sparring.trl.PROMPT}\n\nSURVIVAL: ")
        assert "\nStep 0.\n" in user and "Satellite 2 at (" in user
    # The members of a group have one observation, other groups have another.
    observations = [prompt.split("Step 0.")[1] for prompt in prompts]
    assert [observations.count(text) for text in dict.fromkeys(observations)] == [4, 4]


def test_unreachable_server_leaves_logs_without_metrics(envs, caplog):
    class Unreachable:
        policy_version = 0

        def metrics(self):
            raise sparring.CurriculumError("no server answers")

    from transformers import TrainerState

    callback, logs = sparring.trl.CurriculumCallback(Unreachable()), {"loss": 1.0}
    callback.on_log(None, TrainerState(), None, logs=logs)
    assert logs == {"loss": 1.0}
    assert "no server answers" in caplog.text


def test_printed_command_trains(tmp_path, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    output = run_command(printed_command("docs/guides/train-trl.md", "python examples/grpo_in_process.py --tiny"), tmp_path)
    print(output)
    assert "8 episodes finished, 8 counted" in output
    assert (tmp_path / "grpo" / "adapter_model.safetensors").exists()
