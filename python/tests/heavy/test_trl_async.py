"""TRL's AsyncGRPO with the curriculum of a real server, in its spawned worker, with tiny models. Run by hand: make test-heavy

The trainer and its worker are TRL's. `examples/tiny_generation_server.py` answers instead of vLLM, and computes flash attention.
"""

import argparse
import collections
import concurrent.futures
import contextlib
import multiprocessing
import os
import pickle
import signal
import sys
from pathlib import Path

import pytest
from conftest import BINARY, needs_server
from curriculum_servers import SETTINGS, read_episodes, wait_until
from documents import printed_command, run_command

pytest.importorskip("trl")
pytest.importorskip("aiohttp")
import torch
from trl.experimental.async_grpo import AsyncGRPOConfig, AsyncGRPOTrainer
from trl.experimental.async_grpo.async_rollout_worker import AsyncRolloutWorker

import sparring
import sparring.trl

sys.path.insert(0, os.fspath(Path(__file__).parents[3] / "examples"))
grpo_async = pytest.importorskip("grpo_async")

pytestmark = needs_server
torch.set_num_threads(1)
#: Group size of all tests.
SIZE = 4


@pytest.fixture(scope="module")
def url():
    with sparring.Curriculum.local(binary=BINARY, settings=SETTINGS) as owner:
        yield owner.url


@pytest.fixture
def envs(url):
    with open_factory(url) as factory:
        yield factory


@contextlib.contextmanager
def open_factory(url, *tasks, **arguments):
    """Opens a run of some tasks and a factory of its environments."""
    settings = {**SETTINGS, "tasks": list(tasks) or ["kessler/survival"], "group_size": SIZE}
    with (
        sparring.Curriculum(url, settings=settings) as curriculum,
        sparring.trl.EnvironmentFactory(curriculum, SIZE, **arguments) as factory,
    ):
        yield factory


def read_leases(factory):
    """Returns the leases of the run of a factory."""
    return factory.curriculum.request("GET", f"/v1/runs/{factory.curriculum.run}/leases?limit=500")["leases"]


def count_by_scenario(factory):
    """Returns the number of counted episodes of each scenario."""
    return collections.Counter(episode["scenario_id"] for episode in read_episodes(factory.curriculum))


def copy_for_worker(factory):
    """Returns the factory as a spawned worker gets it."""
    return pickle.loads(pickle.dumps(factory))


def test_pickled_factory_has_the_address_of_the_run(url, monkeypatch):
    with open_factory(url, reward="skill", max_debris=3, lease_groups=2) as envs:
        monkeypatch.setattr(envs._group_curriculum, "token", "sparring-secret")
        worker = copy_for_worker(envs)
        assert isinstance(worker, sparring.trl.WorkerFactory)
        settings = worker.settings
        assert (settings.url, settings.run, settings.token) == (url, envs.curriculum.run, "sparring-secret")
        assert (settings.reward, settings.max_debris, settings.lease_groups, settings.tools) == ("skill", 3, 2, "kessler")
        # A spawned process reads the variable itself.
        monkeypatch.setenv("SPARRING_TOKEN", "sparring-secret")
        assert b"sparring-secret" not in pickle.dumps(envs)
        assert copy_for_worker(worker).settings.run == envs.curriculum.run
        assert not read_leases(envs)
        assert os.path.exists(settings.version_file)
    assert not os.path.exists(settings.version_file)


def test_concurrent_members_share_scenario_and_have_versions(envs):
    threads = len(os.listdir("/proc/self/task"))
    worker = copy_for_worker(envs)
    members = [worker() for _ in range(3 * SIZE)]
    envs.policy_version = 5
    with concurrent.futures.ThreadPoolExecutor(len(members)) as pool:
        # Three groups at once, all members in threads of their own. The third is not complete when the policy changes.
        groups = [*"abba" * 2, *"cc"]
        list(pool.map(lambda member, group: member.reset(group_id=group, prompt=[]), members, groups))
        envs.policy_version = 6
        list(pool.map(lambda member: member.reset(group_id="c"), members[-2:]))
        scenarios = [member.scenario for member in members]
        rewards = list(pool.map(lambda member: member.get_reward(), members))
    worker.close()
    assert len(set(scenarios)) == len({*zip([*groups, "c", "c"], scenarios, strict=True)}) == 3
    episodes = read_episodes(envs.curriculum)
    assert sorted(episode["score"] for episode in episodes) == pytest.approx(sorted(rewards), abs=1e-6)
    versions = collections.Counter((episode["scenario_id"], episode["policy_version"]) for episode in episodes)
    assert versions == {
        (scenarios[0].id, 5): SIZE, (scenarios[1].id, 5): SIZE, (scenarios[8].id, 5): 2, (scenarios[8].id, 6): 2,
    }  # fmt: skip
    assert all(lease["status"] != "active" for lease in read_leases(envs))
    assert len(os.listdir("/proc/self/task")) <= threads
    with pytest.raises(sparring.CurriculumError, match="closed"):
        members[0].reset(group_id="d")


def run_part_of_a_group(factory, has_begun, may_end):
    """Runs one episode of a group to its end and begins the others, in a spawned process."""
    members = [factory() for _ in range(SIZE)]
    for member in members:
        member.reset(group_id="a")
    members[0].get_reward()
    members[1].hold(5)
    has_begun.set()
    may_end.wait()


@pytest.mark.parametrize("end", ["return", "signal"])
def test_ended_worker_returns_unfinished_episodes(envs, end):
    context = multiprocessing.get_context("spawn")
    has_begun, may_end = context.Event(), context.Event()
    process = context.Process(target=run_part_of_a_group, args=(envs, has_begun, may_end))
    process.start()
    assert has_begun.wait(120)
    assert any(lease["status"] == "active" for lease in read_leases(envs))
    if end == "return":
        may_end.set()
    else:
        process.terminate()
    process.join(60)
    assert process.exitcode == (0 if end == "return" else -signal.SIGTERM)
    (episode,) = read_episodes(envs.curriculum)
    assert episode["policy_version"] == envs.policy_version
    assert all(lease["status"] == "released" for lease in read_leases(envs))


def spawn_worker(url, run, has_begun):
    """Spawns a worker, as a trainer does, and waits."""
    curriculum = sparring.Curriculum(url, run)
    factory = sparring.trl.EnvironmentFactory(curriculum, SIZE)
    context = multiprocessing.get_context("spawn")
    never = context.Event()
    worker = context.Process(target=run_part_of_a_group, args=(factory, has_begun, never), daemon=True)
    worker.start()
    worker.join()


def test_worker_of_a_killed_trainer_ends(envs, tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", os.fspath(tmp_path))
    context = multiprocessing.get_context("spawn")
    has_begun = context.Event()
    trainer = context.Process(target=spawn_worker, args=(envs.curriculum.url, envs.curriculum.run, has_begun))
    trainer.start()
    assert has_begun.wait(120)
    assert list(tmp_path.glob("sparring-policy-version-*"))
    trainer.kill()
    trainer.join()
    wait_until(lambda: all(lease["status"] == "released" for lease in read_leases(envs)))
    assert len(read_episodes(envs.curriculum)) == 1
    assert not list(tmp_path.glob("sparring-policy-version-*"))


def make_trainer(stack, envs, folder, calls=3, **settings):
    """Makes TRL's trainer with a tiny model and a server of it; returns both."""
    arguments = {"output": os.fspath(folder), "steps": 2, "groups": 1, "group_size": SIZE, "tokens": 16, "calls": calls}
    args = argparse.Namespace(tiny=True, **arguments)
    named = envs if isinstance(envs, dict) else sparring.trl.Environments({"": envs})
    model = os.fspath(folder / "tiny")
    server, more = grpo_async.make_tiny_model(named, model)
    stack.callback(server.stop)
    config = grpo_async.make_config(args, server.url)
    config.disable_tqdm, config.seed, config.save_strategy = True, 1, "no"
    for name, value in settings.items():
        setattr(config, name, value)
    trainer = AsyncGRPOTrainer(
        model=model,
        args=config,
        train_dataset=envs.dataset(4),
        environment_factory=envs,
        callbacks=[sparring.trl.CurriculumCallback(envs)],
        **more,
    )
    return trainer, server


def assert_groups_are_complete(sizes, trained):
    """Checks the sizes of groups: at most one group is not complete, and the trainer learned from some of the others."""
    sizes = sorted(sizes, reverse=True)
    assert all(size == SIZE for size in sizes[:-1]) and sizes[-1] <= SIZE and sizes.count(SIZE) >= trained, sizes


def first_prompts(server):
    """Returns the requests of each rollout's first answer."""
    return [request for request in server.requests if request.prompt.count("<|im_start|>assistant\n") == 1]


def test_trainer_and_spawned_worker_train(envs, tmp_path):
    with contextlib.ExitStack() as stack:
        trainer, server = make_trainer(stack, envs, tmp_path, max_steps=4)
        before = [weight.detach().clone() for weight in trainer.model.parameters()]
        trainer.train()
        assert trainer.rollout_worker._process is None
    assert trainer.state.global_step == 4 and server.updates == 5
    assert any(not torch.equal(a, b) for a, b in zip(before, trainer.model.parameters(), strict=True))
    # The goal and the observation of `reset` are in the prompt, and the members of a group have the same ones. The end of the
    # training may stop the worker in the middle of a group.
    first = first_prompts(server)
    assert all(f"{sparring.trl.PROMPT}\n\nSURVIVAL: " in prompt and "\nStep 0.\n" in prompt for prompt, _ in first)
    assert_groups_are_complete(collections.Counter(prompt for prompt, _ in first).values(), trained=4)
    # The worker finishes its rollouts before it ends, and the server has counted all of them.
    assert_groups_are_complete(count_by_scenario(envs).values(), trained=4)
    episodes = read_episodes(envs.curriculum)
    assert len(episodes) == len(first)
    assert all(lease["status"] != "active" for lease in read_leases(envs))
    # The policy version counts the updates of the weights that generated the episode; the first update is before the training.
    reported = collections.Counter(episode["policy_version"] for episode in episodes)
    generated = collections.Counter(updates - 1 for _, updates in first)
    print("episodes by reported version", sorted(reported.items()), "by version of the weights", sorted(generated.items()))
    assert len(reported) > 1
    assert all(abs(reported[version] - generated[version]) <= SIZE for version in range(5))
    logged = [row for row in trainer.state.log_history if "rewards/ToolEnvironment" in row]
    assert len(logged) == 4 and any(row["tools/call_frequency"] > 0 for row in logged)
    assert all("curriculum/kessler/survival/zero_variance_share" in row for row in logged[1:])


def test_trainer_routes_prompts_to_environments_by_name(url, tmp_path):
    with contextlib.ExitStack() as stack:
        survival = stack.enter_context(open_factory(url))
        docking = stack.enter_context(open_factory(url, "docking/single"))
        envs = stack.enter_context(sparring.trl.Environments({"survival": survival, "docking": docking}))
        trainer, server = make_trainer(stack, envs, tmp_path)
        trainer.train()
        first = [prompt for prompt, _ in first_prompts(server)]
        in_survival = [
            prompt for prompt in first if "SURVIVAL: " in prompt and '"fire_thrusters"' in prompt and '"coast"' not in prompt
        ]
        in_docking = [
            prompt for prompt in first if "DOCKING: " in prompt and '"coast"' in prompt and '"fire_thrusters"' not in prompt
        ]
        print(f"{len(in_survival)} episodes of survival, {len(in_docking)} of docking")
        assert len(in_survival) + len(in_docking) == len(first)
        assert sum(count_by_scenario(survival).values()) == len(in_survival) >= SIZE
        assert sum(count_by_scenario(docking).values()) == len(in_docking) >= SIZE
        for factory in envs.values():
            assert_groups_are_complete(count_by_scenario(factory).values(), trained=1)
        logged = trainer.state.log_history[-2]
        assert {"rewards/ToolEnvironment", "rewards/DockingEnvironment"} <= set(logged)
        assert "curriculum/docking/docking/single/level" in logged


def test_worker_that_trl_terminates_returns_its_episodes(envs, tmp_path):
    with contextlib.ExitStack() as stack:
        trainer, server = make_trainer(stack, envs, tmp_path)
        worker = trainer.rollout_worker
        assert isinstance(worker, AsyncRolloutWorker)
        # No rollout can end, because the generation server does not answer any more: TRL terminates the worker after 15 s.
        stack.enter_context(server.lock)
        worker.start()
        process = worker._process
        wait_until(lambda: any(lease["status"] == "active" for lease in read_leases(envs)))
        worker.stop()
        assert process.exitcode == -signal.SIGTERM
        assert all(lease["status"] == "released" for lease in read_leases(envs))
        assert not read_episodes(envs.curriculum)


def test_unsuitable_argument_is_named(envs, tmp_path):
    callback = sparring.trl.CurriculumCallback(envs)
    for size, evaluation, field in ((2, "no", "num_generations"), (SIZE, "epoch", "eval_strategy")):
        folder = os.fspath(tmp_path)
        args = AsyncGRPOConfig(folder, num_generations=size, eval_strategy=evaluation, use_cpu=True, bf16=False)
        with pytest.raises(ValueError, match=field):
            callback.on_train_begin(args, None, None)


def test_printed_command_trains(tmp_path, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    output = run_command(printed_command("docs/guides/train-trl.md", "python examples/grpo_async.py --tiny"), tmp_path)
    print(output)
    assert "docking: docking/single: no level, " in output
    assert (tmp_path / "grpo-async" / "model.safetensors").exists()
