"""Trajectory feeds on NATS: a real server, a real NATS server, and trainers that read the feed."""

import asyncio
import contextlib
import re
import subprocess
import threading
import time

import pytest
from conftest import BINARY, needs_server
from curriculum_servers import SETTINGS, wait_until
from documents import code_blocks
from nats_server import NatsServer, needs_nats

import sparring
from sparring.feed import AsyncNatsFeed, FeedError

pytestmark = [needs_server, needs_nats]


@pytest.fixture(scope="module")
def nats(tmp_path_factory):
    with NatsServer(tmp_path_factory.mktemp("nats")) as server:
        yield server


@contextlib.contextmanager
def served(nats, *flags):
    """Starts a server that uses NATS; yields a client of it."""
    command = [BINARY, "serve", "--bind", "127.0.0.1:0", "--temporary", "--while-stdin", "--nats", nats.url, *flags]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        assert server.stdin is not None and server.stdout is not None
        match = re.search(r"http://\S+", server.stdout.readline())
        assert match is not None
        with sparring.Client(match[0]) as client:
            yield client
        server.stdin.close()


@pytest.fixture(scope="module")
def client(nats):
    with served(nats) as client:
        yield client


def create_run(client, name, groups=8, group_size=2):
    """Creates a run whose feed is delivered by NATS."""
    client.runs.create(**SETTINGS, id=name, group_size=group_size)
    set_policy(client, name, "random", groups)


def set_policy(client, name, policy, groups=8):
    client.trajectories.set_policy(name, policy=policy, max_unacknowledged_groups=groups, delivery="nats")


def wait_until_full(client, name):
    """Waits until the server has rolled out as many groups as the feed holds."""
    wait_until(lambda: client.trajectories.get_policy(name)["feed"]["full"])


def open_feed(nats, run, **options):
    """Opens a feed, once the server has created its stream."""
    for _ in range(100):
        with contextlib.suppress(FeedError):
            return sparring.feed.nats(nats.url, run, **options)
        time.sleep(0.2)
    raise AssertionError(f"the run {run} has no stream")


def test_groups_are_those_of_the_http_feed(client, nats):
    create_run(client, "same")
    with open_feed(nats, "same") as feed:
        wait_until_full(client, "same")
        expected = client.trajectories.read("same", limit=8)["groups"]
        received = [feed.receive(30) for _ in range(8)]
        assert [group["deliveries"] for group in received] == [1] * 8
        assert [{**group, "deliveries": 0} for group in received] == expected
        assert feed.acknowledge()
        wait_until(lambda: client.trajectories.get_policy("same")["feed"]["acknowledged"] >= 8)
        assert feed.state()["policy"] == "random"
        # A group that is returned comes again. NATS may deliver new groups before.
        released = feed.receive(30)
        feed.release()
        later = [feed.receive(30)]
        while later[-1]["id"] != released["id"]:
            later.append(feed.receive(30))
        assert [group["deliveries"] for group in later] == [1] * (len(later) - 1) + [2]
    set_policy(client, "same", "off")


def test_trainers_share_or_receive_all(client, nats):
    create_run(client, "shared")
    feeds = [open_feed(nats, "shared", consumer=name) for name in ("pair", "pair", "alone")]
    taken = [[], [], []]
    threads = [
        threading.Thread(target=lambda feed=feed, ids=ids, count=count: ids.extend(group["id"] for group in limited(feed, count)))
        for feed, ids, count in zip(feeds, taken, (10, 10, 20), strict=True)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for feed in feeds:
        feed.close()
    assert sorted(taken[0] + taken[1]) == sorted(taken[2]) == sorted(set(taken[2]))
    assert taken[2] == sorted(taken[2])
    set_policy(client, "shared", "off")


def limited(feed, count):
    """Yields groups, and acknowledges the last one, too."""
    for _ in range(count):
        yield feed.receive(60)
        feed.acknowledge()


def test_large_groups_and_kills_of_nats(client, nats):
    create_run(client, "large", group_size=16)
    ids = []
    # A killed NATS may deliver a group late, after `ack_wait_s`, and others before it.
    with open_feed(nats, "large", idle_s=60, ack_wait_s=5) as feed:
        for group in feed:
            ids.append(group["id"])
            assert len(group["episodes"]) == 16
            if len(ids) in (4, 9):
                nats.kill()
                nats.start()
            if len(ids) == 14:
                break
        set_policy(client, "large", "off")

        def is_acknowledged():
            group = feed.receive(0.5)
            ids.extend([] if group is None else [group["id"]])
            return client.trajectories.get_policy("large")["feed"]["acknowledged"] >= 14

        wait_until(is_acknowledged)
    assert len(ids) == len(set(ids)), "no group is repeated"


def test_asynchronous_trainer_and_idle_end(client, nats):
    create_run(client, "async", groups=3)
    open_feed(nats, "async").close()
    wait_until_full(client, "async")

    async def train():
        ids = []
        async with AsyncNatsFeed(nats.url, "async", idle_s=5) as feed:
            async for group in feed:
                ids.append(group["id"])
                if len(ids) == 3:
                    set_policy(client, "async", "off")
        return ids

    ids = asyncio.run(train())
    assert len(ids) >= 3 and ids == sorted(set(ids))


def test_run_of_a_shard_has_a_feed(nats):
    with served(nats, "--shard", "east", "--nats-name", "shards") as client:
        for name, group_size in [("east.small_run", 2), ("east.large-run", 16)]:
            create_run(client, name, groups=3, group_size=group_size)
            with open_feed(nats, name, cluster="shards") as feed:
                wait_until_full(client, name)
                expected = client.trajectories.read(name, limit=3)["groups"]
                assert [{**feed.receive(60), "deliveries": 0} for _ in range(3)] == expected
                assert feed.acknowledge()
                wait_until(lambda name=name: client.trajectories.get_policy(name)["feed"]["acknowledged"] >= 3)
                assert feed.state()["policy"] == "random"
            set_policy(client, name, "off")
        with pytest.raises(FeedError, match="the run small_run has no feed on NATS"):
            sparring.feed.nats(nats.url, "small_run", cluster="shards")


def test_errors_name_their_cause(client, nats):
    with pytest.raises(FeedError, match=r"the run nowhere has no feed on NATS: set its policy"):
        sparring.feed.nats(nats.url, "nowhere")
    client.runs.create(**SETTINGS, id="by-http")
    with pytest.raises(FeedError, match="the run by-http has no feed"):
        sparring.feed.nats(nats.url, "by-http")


def test_printed_code_reads_a_feed(client, nats, capsys):
    create_run(client, "my-run", groups=3)
    open_feed(nats, "my-run").close()
    wait_until_full(client, "my-run")
    [code] = code_blocks("docs/reference/trajectories.md")
    stop = threading.Timer(3, lambda: set_policy(client, "my-run", "off"))
    stop.start()
    exec(code.replace("nats://127.0.0.1:4222", nats.url).replace("idle_s=60", "idle_s=6"), {})
    stop.join()
    ids = [int(line.split()[0]) for line in capsys.readouterr().out.splitlines()]
    assert len(ids) >= 3 and ids == sorted(set(ids))
