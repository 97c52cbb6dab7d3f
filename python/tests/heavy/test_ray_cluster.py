"""Env runners and actors on two simulated nodes of Ray, with one server that requires a token. Run by hand: make test-heavy"""

import subprocess
import time

import pytest

pytest.importorskip("ray.rllib")
import ray
from conftest import BINARY, needs_server
from curriculum_servers import step_randomly
from ray_clusters import RUNNER, place, simulated_cluster
from test_rllib import active_leases, finished_by_version, local_curriculum, team_config

import sparring
import sparring.rllib

#: Lifetime of the leases, seconds: long enough for an episode of these tests, and short enough to wait for its end.
TTL_S = 6


@pytest.fixture(scope="module")
def token(tmp_path_factory):
    """Token of a database, in the environment of the driver and of all nodes; the database is beside it."""
    db = tmp_path_factory.mktemp("cluster") / "run.sqlite3"
    command = [BINARY, "token", "create", "cluster", "--role", "trainer", "--db", db]
    token = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setenv("SPARRING_TOKEN", token)
        yield db, token


@pytest.fixture(scope="module")
def cluster(token):
    with simulated_cluster() as cluster:
        yield cluster


def open_curriculum(token, **settings):
    return local_curriculum(["kessler/survival"], token[0], **settings)


def cluster_config(curriculum, envs=4, steps=60, **arguments):
    """Returns the config of a training with an env runner on each node."""
    config = team_config(curriculum, envs=envs, steps=steps)
    arguments = {"url": curriculum.url, "run": curriculum.run, "lease_groups": 2, "form": "groups", **arguments}
    config.env_config = {"task": "kessler/survival", "curriculum": arguments}
    config.env_runners(custom_resources_per_env_runner={RUNNER: 1}, sample_timeout_s=30)
    return config.fault_tolerance(env_runner_health_probe_timeout_s=1)


def runner_places(algorithm):
    """Returns stats and running scenarios of each env runner by its node and process."""

    def read(runner):
        env = runner.env.unwrapped
        return place(), (env.curriculum.stats(), {env.envs.scenario(index).id for index in range(env.num_envs)})

    return dict(algorithm.env_runner_group.foreach_env_runner(read, local_env_runner=False))


def settled_places(algorithm):
    """Returns the env runners once the server has acknowledged all of their results."""
    while True:
        places = runner_places(algorithm)
        if not any(stats["unsent"] for stats, _ in places.values()):
            return places
        time.sleep(0.05)


def episodes_of(curriculum):
    """Returns all reported episodes of the run."""
    episodes, cursor = [], ""
    while cursor is not None:
        page = curriculum.request("GET", f"/v1/runs/{curriculum.run}/episodes?limit=500{cursor and f'&cursor={cursor}'}")
        episodes, cursor = episodes + page["episodes"], page["next"]
    return episodes


def leases_of(curriculum):
    """Returns all leases of the run with their groups."""
    path = f"/v1/runs/{curriculum.run}/leases"
    leases = curriculum.request("GET", f"{path}?limit=500")["leases"]
    return [curriculum.request("GET", f"{path}/{lease['lease']}") for lease in leases]


def assert_counted_once(curriculum, acknowledged):
    """Asserts that the server has as many episodes as it acknowledged, each once and finished."""
    episodes = episodes_of(curriculum)
    assert len({episode["episode"] for episode in episodes}) == len(episodes) == acknowledged
    assert {episode["state"] for episode in episodes} == {"finished"}
    assert sum(finished_by_version(curriculum).values()) == acknowledged
    assert curriculum.request("GET", f"/v1/runs/{curriculum.run}")["episodes"] == acknowledged


@needs_server
def test_env_runners_on_two_nodes_share_one_run(cluster, token):
    with open_curriculum(token) as curriculum:
        algorithm = cluster_config(curriculum, envs=32, steps=50).build_algo()
        try:
            started = time.perf_counter()
            results = [algorithm.train() for _ in range(4)]
            seconds = time.perf_counter() - started
            places = settled_places(algorithm)
            assert token[1] not in str(algorithm.config.to_dict())
        finally:
            algorithm.stop()
        nodes = {node for node, _ in places}
        alive = {node["NodeID"] for node in ray.nodes() if node["Alive"] and RUNNER in node["Resources"]}
        assert len(nodes) == len(places) == 2 and nodes <= alive and ray.get_runtime_context().get_node_id() not in nodes
        finished = [stats["finished"] for stats, _ in places.values()]
        assert min(finished) > 60 and [stats["counted"] for stats, _ in places.values()] == finished
        assert_counted_once(curriculum, sum(finished))
        assert not active_leases(curriculum)
        assert results[-1]["curriculum"]["episodes/finished"] == sum(finished)
        steps = sum(result["env_runners"]["num_env_steps_sampled"] for result in results)
        print(f"two nodes: {finished} episodes, {steps / seconds:.0f} env-steps/s with learning")


@needs_server
def test_killed_node_loses_no_acknowledged_result(cluster, token):
    with open_curriculum(token) as curriculum:
        algorithm = cluster_config(curriculum, ttl_s=TTL_S).build_algo()
        try:
            algorithm.train()
            before = settled_places(algorithm)
            ((node, pid), (stats, _)), (_, (_, others)) = before.items()
            acknowledged = stats["counted"]
            assert acknowledged == stats["finished"] > 0
            cluster.kill_node(node, pid)
            assert len(episodes_of(curriculum)) == sum(stats["counted"] for stats, _ in before.values())
            # The other env runner continues, and gets the lost scenarios once their lease has expired.
            lost, served, iterations = set(), set(), 0
            while not lost or not lost <= served:
                algorithm.train()
                iterations += 1
                assert iterations < 60, (lost, served)
                leases = leases_of(curriculum)
                expired = {lease["lease"] for lease in leases if lease["status"] == "expired"}
                groups = [(lease["lease"] in expired, group) for lease in leases for group in lease["groups"]]
                lost = {group["scenario"] for ended, group in groups if ended and group["state"] == "lost"}
                served = {group["scenario"] for ended, group in groups if not ended}
            ((survivor, (stats, _)),) = settled_places(algorithm).items()
            assert survivor in before and survivor != (node, pid)
            assert stats["late"] == 0 and not lost & others, "only the killed env runner lost scenarios"
            assert_counted_once(curriculum, acknowledged + stats["counted"])
            print(f"{len(lost)} lost groups were served again within {iterations} iterations")
            restart_on_new_node(cluster, algorithm, survivor)
            counted = sum(stats["counted"] for stats, _ in settled_places(algorithm).values())
        finally:
            algorithm.stop()
        assert_counted_once(curriculum, acknowledged + counted)
        assert not active_leases(curriculum)


def restart_on_new_node(cluster, algorithm, survivor):
    """Adds a node, on which Ray starts the lost env runner again, and checks its policy version."""
    cluster.add_node()
    places = {survivor}
    for _ in range(30):
        result = algorithm.train()
        places = set(runner_places(algorithm))
        if len(places) == 2:
            break
    assert len(places) == 2 and survivor in places
    versions = algorithm.env_runner_group.foreach_env_runner(
        lambda runner: runner.env.unwrapped.curriculum.policy_version, local_env_runner=False
    )
    assert versions == [result["training_iteration"]] * 2


@ray.remote(num_cpus=0, resources={RUNNER: 1})
class Trainer:
    """Actor with environments of a curriculum that it received pickled."""

    def run_episodes(self, curriculum, steps):
        """Steps environments, submits their results, and returns node, run and number of finished episodes."""
        envs = sparring.make_vec("kessler/survival", 4, curriculum=curriculum)
        envs.reset(seed=1)
        step_randomly(envs, steps)
        envs.close()
        curriculum.close()
        return place()[0], curriculum.run, curriculum.stats()["finished"]


@needs_server
def test_actors_on_two_nodes_receive_a_curriculum(cluster, token):
    with open_curriculum(token) as curriculum:
        actors = [Trainer.remote() for _ in range(2)]
        results = ray.get([actor.run_episodes.remote(curriculum, 70) for actor in actors])
        for actor in actors:
            ray.kill(actor)
        assert len({node for node, *_ in results}) == 2 and {run for _, run, _ in results} == {curriculum.run}
        assert_counted_once(curriculum, sum(finished for *_, finished in results))


def test_address_that_only_one_host_can_reach_is_explained():
    with pytest.raises(sparring.CurriculumError, match=r"address of this host itself .*`url` must name the host of the server"):
        sparring.rllib.team_env({"num_envs": 2, "curriculum": {"url": "http://127.0.0.1:1", "run": "mine"}})


@needs_server
def test_address_comes_from_the_environment(token, monkeypatch):
    with open_curriculum(token) as curriculum:
        monkeypatch.setenv("SPARRING_URL", curriculum.url)
        envs = sparring.rllib.team_env({"num_envs": 2, "curriculum": {"run": curriculum.run}})
        assert envs.curriculum.url == curriculum.url
        envs.close()
