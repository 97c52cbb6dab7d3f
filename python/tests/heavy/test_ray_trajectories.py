"""Actors on two simulated nodes of Ray that pull the trajectories of a run. Run by hand: make test-heavy"""

import functools
import os
import signal
import sys
import time

import pytest

pytest.importorskip("ray")
import ray
from conftest import needs_server
from curriculum_servers import wait_until
from documents import ROOT
from ray_clusters import simulated_cluster
from test_rllib import local_curriculum

import sparring

sys.path.insert(0, os.fspath(ROOT / "examples"))
import ray_trajectories

#: Episodes of a group.
GROUP_SIZE = 4


@pytest.fixture(scope="module")
def cluster():
    with simulated_cluster() as cluster:
        yield cluster


@pytest.fixture
def run():
    """Run with a built-in policy, and a client of its server."""
    with local_curriculum(["kessler/survival"], group_size=GROUP_SIZE) as curriculum, sparring.Client(curriculum.url) as client:
        client.trajectories.set_policy(curriculum.run, policy="random", version=3, max_unacknowledged_groups=16)
        yield client, curriculum


def feed_of(client, run):
    """Returns all groups of the feed by their ids, page by page."""
    groups, page = {}, client.trajectories.read(run)
    while page["groups"]:
        groups.update((group["id"], group) for group in page["groups"])
        page = client.trajectories.read(run, after=page["next"])
    return groups


@needs_server
def test_every_group_arrives_once(cluster, run):
    client, curriculum = run
    # A consumer that died after its claim: the server delivers its groups again.
    wait_until(lambda: client.trajectories.get_policy(curriculum.run)["feed"]["waiting"] >= 3)
    abandoned = [group["id"] for group in client.trajectories.claim(curriculum.run, limit=3, ttl_s=2)["groups"]]
    make_puller = ray_trajectories.Puller.options(num_cpus=1)
    pullers = [make_puller.remote(curriculum.url, curriculum.run, 4, 5) for _ in range(2)]
    pids = ray.get([puller.process.remote() for puller in pullers])
    arrived, rows = [], {}

    def on_row(row):
        arrived.append(row["id"])
        if len(arrived) == 6:
            os.kill(pids[0], signal.SIGKILL)

    started = time.perf_counter()
    ray_trajectories.collect(client, curriculum.run, pullers, rows, lambda: len(rows) >= 40, on_row)
    seconds = time.perf_counter() - started
    ray_trajectories.report(list(rows.values()), seconds)
    client.trajectories.set_policy(curriculum.run, policy="off")
    is_empty = functools.partial(ray_trajectories.is_empty, client, curriculum.run)
    ray_trajectories.collect(client, curriculum.run, pullers, rows, is_empty, on_row)
    assert ray.get(pullers[0].process.remote()) != pids[0], "Ray started the killed actor again"
    for puller in pullers:
        ray.kill(puller)
    assert len(arrived) == len(set(arrived)) == len(rows) >= 40 and set(abandoned) <= rows.keys()
    assert all(rows[id]["deliveries"] >= 2 for id in abandoned)
    assert len({row["node"] for row in rows.values()}) >= 2
    feed, policy = feed_of(client, curriculum.run), client.trajectories.get_policy(curriculum.run)
    assert policy["feed"]["acknowledged"] == len(rows) and is_empty()
    for id, row in rows.items():
        assert row["scores"] == [episode["score"] for episode in feed[id]["episodes"]] and len(row["scores"]) == GROUP_SIZE
        assert row["steps"] == sum(len(episode["steps"]) for episode in feed[id]["episodes"]) and row["version"] == 3


def test_advantages_are_normalised():
    assert ray_trajectories.advantages([0.5, 0.5]) == [0.0, 0.0]
    low, high = ray_trajectories.advantages([0.0, 1.0])
    assert low == -high == pytest.approx(-1.0, abs=1e-3)
