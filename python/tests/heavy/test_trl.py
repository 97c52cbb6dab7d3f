"""TRL's GRPO on the curriculum of a real server, with models made on the spot. Run by hand:

    scripts/heavy-venv
    cd python && SPARRING_BINARY=../target/debug/sparring PYTHONPATH=. ../target/heavy-venv/bin/pytest -o addopts= \
        -o filterwarnings=default -p no:cacheprovider tests/heavy/test_trl.py
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import BINARY, served

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

pytestmark = served
torch.set_num_threads(1)
SETTINGS = {"tasks": ["kessler/survival"], "placement": False, "design": {"designer": "off"}}


def local(siblings=4, **settings):
    return sparring.Curriculum.local(binary=BINARY, settings={**SETTINGS, "group_size": siblings, **settings})


@pytest.fixture(scope="module")
def curriculum():
    with local() as made:
        yield made


@pytest.fixture
def envs(curriculum):
    with sparring.trl.Environments(curriculum, 4) as made:
        yield made


def first_seen(count):
    """What is seen at the beginning of some scenarios."""
    env = sparring.Environment("kessler/survival")
    seen = []
    for seed in range(count):
        env.reset(seed=seed)
        seen.append(f"{env.telemetry()['mission_objective']}\nStep 0.\n{sparring.trl.words(env.telemetry())}")
    return [f"{sparring.trl.PROMPT}\n\n{text}" for text in seen]


def episodes_of(curriculum):
    """What the server has of each episode: outcome, scenario and actions."""
    at = f"/v1/runs/{curriculum.run}/episodes"
    return [curriculum.ask("GET", f"{at}/{row['episode']}") for row in curriculum.ask("GET", f"{at}?limit=500")["episodes"]]


def config_of(folder, siblings=4, groups=1, **more):
    settings = {
        "output_dir": os.fspath(folder),
        "use_cpu": True,
        "bf16": False,
        "max_steps": 2,
        "num_generations": siblings,
        "per_device_train_batch_size": siblings,
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


def test_tools_are_described_as_trl_wants_them(envs):
    pilot = envs()
    schemas = {tool.__name__: get_json_schema(tool)["function"] for tool in (pilot.fire_thrusters, pilot.hold, pilot.telemetry)}
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
    public = {name for name, value in vars(sparring.trl.Pilot).items() if callable(value) and not name.startswith("_")}
    # Whatever is public is a tool, so that there had better be nothing else.
    assert public == {"reset", "get_reward", *schemas}


def test_siblings_fly_one_scenario_and_the_server_scores_them_alike(curriculum):
    with sparring.trl.Environments(curriculum, 4) as envs:
        pilots = [envs() for _ in range(8)]
        # Two groups at once, their siblings in any order.
        for pilot, group in zip(pilots, "abbaabab", strict=True):
            seen = pilot.reset(prompt=[], group_id=group)
            assert "SURVIVAL" in seen and "Satellite 2" in seen
        of = {group: {pilot.scenario for pilot, name in zip(pilots, "abbaabab", strict=True) if name == group} for group in "ab"}
        assert len(of["a"]) == len(of["b"]) == 1
        assert of["a"] != of["b"]
        pilots[0].hold(50)
        with pytest.raises(ValueError, match="over"):
            pilots[0].hold(1)
        for _ in range(12):
            if not pilots[1].over:
                pilots[1].fire_thrusters(0, 0.3, 0.3)
        assert pilots[2].telemetry() == pilots[2].telemetry()
        rewards = [pilot.get_reward() for pilot in pilots]
        assert rewards == [pilot.get_reward() for pilot in pilots]
        assert all(pilot.over for pilot in pilots)
        scenarios = [pilot.scenario for pilot in pilots]
        again = pilots[0].reset(group_id="a")
        assert "Step 0." in again
        assert pilots[0].scenario != scenarios[0]
        envs.flush()
        stats = envs.stats()
    assert stats["flown"] == stats["counted"] + stats["stored"] == 8
    told = episodes_of(curriculum)
    assert [told_of["scenario_id"] for told_of in told].count(scenarios[0].id) == 4
    earned = sorted((pilot_of.id, reward) for pilot_of, reward in zip(scenarios, rewards, strict=True))
    scored = sorted((episode["scenario_id"], episode["score"]) for episode in told)
    assert [one for one, _ in scored] == [one for one, _ in earned]
    assert [score for _, score in scored] == pytest.approx([reward for _, reward in earned], abs=1e-6)


def test_skill_is_that_of_the_bracket(curriculum):
    with sparring.trl.Environments(curriculum, 4, reward="skill") as envs:
        pilots = [envs() for _ in range(4)]
        for pilot in pilots:
            pilot.reset()
        reward = pilots[0].get_reward()
        known = sparring.bracket(pilots[0].scenario)
        assert reward == pytest.approx(known.skill(pilots[0].score) or 0.0)
        assert pilots[0].score == pytest.approx(known.hold, abs=1e-6)


def test_nothing_is_learnt_where_a_strategy_only_wants_to_know():
    with local(strategy="plr_robust") as curriculum, sparring.trl.Environments(curriculum, 4) as envs:
        pilots = [envs() for _ in range(4)]
        for pilot in pilots:
            pilot.reset(group_id="a")
        pilots[0].fire_thrusters(0, 1.0, 1.0)
        assert [pilot.get_reward() for pilot in pilots] == [0.0] * 4
        assert all(pilot.score > 0 for pilot in pilots)
        envs.flush()
        assert envs.stats()["flown"] == 4


def test_what_is_not_flown_is_given_back(curriculum):
    with sparring.trl.Environments(curriculum, 4) as envs:
        pilots = [envs() for _ in range(4)]
        for pilot in pilots:
            pilot.reset(group_id="a")
        pilots[0].get_reward()
        torn = pilots[0].scenario
        # A training that stopped amid a group, and one that begins.
        for pilot in pilots:
            pilot.reset(group_id="b")
        assert len({pilot.scenario for pilot in pilots}) == 1
        assert pilots[0].scenario != torn
        for pilot in pilots:
            pilot.get_reward()
        last = pilots[0].scenario
        # Somebody who took an episode out of the middle: the next groups are whole all the same.
        amid = sparring.Environment(curriculum=envs._feed)
        amid.reset()
        for pilot in pilots:
            pilot.reset(group_id="c")
        assert len({pilot.scenario for pilot in pilots}) == 1
        assert amid.scenario not in {pilot.scenario for pilot in pilots}
        for pilot in pilots:
            pilot.get_reward()
        envs.flush()
        assert envs.stats()["flown"] == 9
    at = f"/v1/runs/{curriculum.run}/leases"
    leases = [curriculum.ask("GET", f"{at}/{lease['lease']}") for lease in curriculum.ask("GET", f"{at}?limit=500")["leases"]]
    ended = {group["scenario"]: (lease["status"], group["state"]) for lease in leases for group in lease["groups"]}
    assert ended[torn.id] == ("released", "lost")
    assert ended[last.id] == ended[pilots[0].scenario.id] == ("done", "complete")


def test_what_a_model_calls_wrongly_moves_nothing(envs):
    pilot = envs()
    with pytest.raises(Exception, match="reset"):
        pilot.hold(1)
    pilot.reset()
    before = pilot.telemetry()
    for wrong in ({"satellite_id": 3}, {"satellite_id": "a"}, {"delta_vx": "much"}, {"delta_vy": float("nan")}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            pilot.fire_thrusters(**{"satellite_id": 0, "delta_vx": 0.1, "delta_vy": 0.1, **wrong})
    with pytest.raises(ValueError, match="steps"):
        pilot.hold(0)
    assert pilot.telemetry() == before
    pilot.fire_thrusters(0, 1e300, "0.5")
    assert "Step 1." in pilot.telemetry()


def test_wrong_settings_are_named(curriculum, envs, tmp_path):
    with pytest.raises(ValueError, match="reward"):
        sparring.trl.Environments(curriculum, 4, reward="luck")
    with pytest.raises(ValueError, match="siblings"):
        sparring.trl.Environments(curriculum, 0)
    with local(tasks=["docking/single"]) as other, pytest.raises(ValueError, match="docking/single"):
        sparring.trl.Environments(other, 4)
    callback = sparring.trl.CurriculumCallback(envs)
    for wrong, field in (
        ({"siblings": 2}, "num_generations"),
        ({"per_device_train_batch_size": 2, "groups": 3, "generation_batch_size": 12}, None),
        ({"per_device_train_batch_size": 2, "gradient_accumulation_steps": 2}, None),
        ({"eval_strategy": "steps", "eval_steps": 1, "per_device_eval_batch_size": 4}, "eval_strategy"),
    ):
        args = config_of(tmp_path, **wrong)
        if field is None:
            args.steps_per_generation = 3 if "groups" in wrong else 1
            field = "per_device_train_batch_size"
        with pytest.raises(ValueError, match=field):
            callback.on_train_begin(args, None, None)


def test_a_random_model_takes_two_steps(tmp_path):
    with local() as curriculum, sparring.trl.Environments(curriculum, 4) as envs:
        model, tokenizer = tiny_model.tiny([sparring.trl.PROMPT])
        trainer = train(envs, model, tokenizer, config_of(tmp_path, groups=2), groups=4)
        envs.flush()
        stats = envs.stats()
        # It calls nothing: all is held, and nobody does better than another.
        assert trainer.state.global_step == 2
        assert stats["flown"] == stats["counted"] + stats["stored"] == 2 * 2 * 4
        for row in trainer.state.log_history[:2]:
            assert row["tools/call_frequency"] == 0
            assert row["reward_std"] == pytest.approx(0.0, abs=1e-6) or row["frac_reward_zero_std"] == 1.0
            assert row["curriculum/kessler/survival/zero_variance_share"] == 1.0
        episodes = episodes_of(curriculum)
        assert len(episodes) == 16
        assert len({episode["scenario_id"] for episode in episodes}) == 4


def test_a_model_that_calls_tools_learns_from_its_siblings(tmp_path):
    with local(siblings=8) as curriculum, sparring.trl.Environments(curriculum, 8) as envs:
        tools = [envs().fire_thrusters, envs().hold, envs().telemetry]
        burns = [tiny_model.call("fire_thrusters", satellite_id=n, delta_vx=0.9, delta_vy=-0.9) for n in range(3)]
        answers = [*burns, tiny_model.call("hold", steps=5), tiny_model.call("telemetry"), {"content": "Done."}]
        prompts = first_seen(8)
        model, tokenizer = tiny_model.tiny(prompts, answers, tools)
        tiny_model.teach(model, tokenizer, prompts, answers, tools)
        before = {name: weight.detach().clone() for name, weight in model.named_parameters()}
        config = config_of(tmp_path, siblings=8, groups=2, max_completion_length=1024, learning_rate=1e-4)
        trainer = train(envs, model, tokenizer, config, groups=4)
        envs.flush()
        stats = envs.stats()
        logged = [row for row in trainer.state.log_history if "tools/call_frequency" in row]
        print(json.dumps(logged, indent=1))
        assert len(logged) == 2
        assert all(row["tools/call_frequency"] > 0.5 for row in logged)
        assert all(row["tools/failure_frequency"] < 0.5 for row in logged)
        assert stats["flown"] == stats["counted"] + stats["stored"] == 2 * 2 * 8
        episodes = episodes_of(curriculum)
        groups = {}
        for episode in episodes:
            groups.setdefault(episode["scenario_id"], []).append(episode)
        assert sorted(map(len, groups.values())) == [8, 8, 8, 8]
        # Some burned and some did not, so that they earned differently, and something was learnt.
        acted = [any(episode["actions"]["steps"]) for episode in episodes]
        assert any(acted) and not all(acted)
        assert any(len({episode["score"] for episode in siblings}) > 1 for siblings in groups.values())
        moved = max(float((weight - before[name]).abs().max()) for name, weight in model.named_parameters())
        assert moved > 0
        # The second step flew with the policy that the first had made.
        assert {episode["policy_version"] for episode in episodes} == {0, 1}
        assert curriculum.mastery()[0]["plain"]["episodes"] == 32
    events = EventAccumulator(os.fspath(tmp_path / "runs" / "curriculum"))
    events.Reload()
    tags = set(events.Tags()["scalars"])
    for name in ("level", "mastery", "success", "skill", "score", "zero_variance_share", "params/debris"):
        assert f"curriculum/kessler/survival/{name}" in tags or name == "skill", name
    assert [event.step for event in events.Scalars("curriculum/kessler/survival/level")][:2] == [1, 2]
    assert events.Scalars("curriculum/episodes/flown")[-1].value == 32
    assert "curriculum/kessler/survival/mastery" in trainer.state.log_history[0]


def test_a_server_that_is_away_costs_a_point_of_a_curve(envs, caplog):
    class Away:
        policy_version = 0

        def numbers(self):
            raise sparring.CurriculumError("no server answers")

    from transformers import TrainerState

    callback, logs = sparring.trl.CurriculumCallback(Away()), {"loss": 1.0}
    callback.on_log(None, TrainerState(), None, logs=logs)
    assert logs == {"loss": 1.0}
    assert "no server answers" in caplog.text


def test_the_example(tmp_path):
    wish = ["--tiny", "--lora", "--steps", "2", "--siblings", "4", "--tokens", "512"]
    line = [sys.executable, os.fspath(EXAMPLES / "trl_grpo.py"), *wish, "--output", os.fspath(tmp_path)]
    env = {**os.environ, "SPARRING_BIN": BINARY, "OMP_NUM_THREADS": "1"}
    ended = subprocess.run(line, env=env, capture_output=True, text=True, timeout=500)
    assert ended.returncode == 0, ended.stderr[-3000:]
    print(ended.stdout)
    assert "8 episodes flown, 8 counted" in ended.stdout
    assert (tmp_path / "adapter_model.safetensors").exists()
