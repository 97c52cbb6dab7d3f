"""Connections of feeds to real NATS servers: TLS, users and permissions."""

import argparse
import asyncio
import gc
import importlib.util
import json
import socket
import threading
import time

import pytest
from documents import ROOT
from nats_server import NatsServer, needs_nats
from tls_files import create_tls_files

import sparring
from sparring.feed import FeedError

pytest.importorskip("nats")

from nats.errors import SecureConnWantedError

from sparring import feed_connection

pytestmark = needs_nats

#: Error of a feed whose connection works.
CONNECTED = "the run nowhere has no feed on NATS"
NO_TLS = "the NATS server does not require TLS"


def open_nowhere(server, **arguments):
    """Opens the feed of a run that does not exist."""
    sparring.feed.nats(server, "nowhere", **arguments)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return create_tls_files(tmp_path_factory.mktemp("tls"))


def tls_flags(files):
    return "--tls", "--tlscert", files / "cert.pem", "--tlskey", files / "key.pem"


def test_plain_text_is_refused_where_tls_is_required(files, tmp_path):
    with NatsServer(tmp_path) as nats:
        started = time.monotonic()
        with pytest.raises(FeedError, match=NO_TLS):
            open_nowhere(nats.url, ca_file=files / "ca.pem")
        with pytest.raises(FeedError, match=NO_TLS):
            open_nowhere(f"tls://{nats.address}")
        assert time.monotonic() - started < feed_connection.CONNECT_S
        with pytest.raises(FeedError, match=CONNECTED):
            open_nowhere(nats.url)


def test_plain_server_receives_no_password(files):
    received = []

    def serve(listener):
        connection, _ = listener.accept()
        with connection:
            connection.sendall(b'INFO {"server_id":"a","version":"2.10.0","max_payload":1048576,"auth_required":true}\r\n')
            received.append(connection.recv(4096))

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve, args=[listener])
        thread.start()
        with pytest.raises(FeedError, match=NO_TLS):
            open_nowhere(f"nats://user:secret@127.0.0.1:{listener.getsockname()[1]}", ca_file=files / "ca.pem")
        thread.join()
    assert received == [b""]


def test_tls_needs_the_authority_of_the_server(files, tmp_path):
    with NatsServer(tmp_path, *tls_flags(files)) as nats:
        with pytest.raises(FeedError, match=CONNECTED):
            open_nowhere(nats.url, ca_file=files / "ca.pem")
        with pytest.raises(FeedError, match=r"the certificate of NATS is not valid here \(.+\): set `ca_file`"):
            open_nowhere(nats.url)
        with pytest.raises(FeedError, match=r"the certificate of NATS is not valid here \(.+\): set `ca_file`"):
            open_nowhere(f"nats://localhost:{nats.port}", ca_file=files / "ca.pem")


def test_example_trains_with_an_authority_of_its_own(files, tmp_path, capsys):
    spec = importlib.util.spec_from_file_location("feed_nats", ROOT / "examples/feed_nats.py")
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)

    async def train(args):
        connection = feed_connection.NatsConnection(args.nats, None, args.ca_file)
        await connection.open()
        js = connection.jetstream()
        await js.add_stream(name=example.stream_of(args.nats_name, args.run), subjects=["feed"])
        group = {"id": 7, "task": "kessler/survival", "policy_version": 1, "episodes": [{"score": 1.0, "steps": []}]}
        await js.publish("feed", json.dumps(group).encode())
        await connection.close()
        await example.train(args)

    with NatsServer(tmp_path, *tls_flags(files)) as nats:
        options = {"nats_name": "default", "nkey": None, "consumer": "trainer", "groups": 1}
        asyncio.run(train(argparse.Namespace(nats=nats.url, run="east.my-run", ca_file=files / "ca.pem", **options)))
    assert capsys.readouterr().out == "group    7 kessler/survival version 1\n1 groups, 0 actions with an advantage\n"


def test_unusable_connection_can_be_closed():
    with pytest.raises(FeedError, match="invalid hostname in connect url"):
        open_nowhere("nats://none")
    asyncio.run(sparring.feed.AsyncNatsFeed("nats://127.0.0.1:1", "nowhere").close())


def test_next_connection_needs_tls_too(files, tmp_path):
    async def reconnect(encrypted):
        connection = feed_connection.NatsConnection(encrypted.url, None, files / "ca.pem")
        await connection.open()
        encrypted.kill()
        with NatsServer(tmp_path, port=encrypted.port):
            while not isinstance(connection.last_error, SecureConnWantedError):
                assert not connection.is_connected or connection.last_error is None
                await asyncio.sleep(0.01)
        encrypted.start()
        while not connection.is_connected:
            await asyncio.sleep(0.01)
        assert connection._is_encrypted()
        await connection.close()

    with NatsServer(tmp_path, *tls_flags(files)) as encrypted:
        asyncio.run(asyncio.wait_for(reconnect(encrypted), 60))


def test_rejected_user_is_explained(tmp_path):
    with NatsServer(tmp_path, "--user", "u", "--pass", "p") as nats:
        started = time.monotonic()
        with pytest.raises(FeedError, match=r"NATS requires a user: set `credentials` .* or put its name .* into `server`"):
            open_nowhere(nats.url)
        with pytest.raises(FeedError, match="NATS rejects the user or the password in `server`") as error:
            open_nowhere(f"nats://u:secret@{nats.address}")
        assert "secret" not in str(error.value)
        assert time.monotonic() - started < feed_connection.CONNECT_S
        with pytest.raises(FeedError, match=CONNECTED):
            open_nowhere(f"nats://u:p@{nats.address}")


def test_user_of_one_address_is_that_of_all(tmp_path):
    with NatsServer(tmp_path, "--user", "u", "--pass", "p") as nats:
        for _ in range(3):  # the order of the addresses is random
            with pytest.raises(FeedError, match=CONNECTED):
                open_nowhere(f"nats://u:p@127.0.0.1:1,{nats.url}")


# nats-py leaves the sockets of rejected attempts to the garbage collector.
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
def test_user_that_is_removed_ends_the_feed(tmp_path, monkeypatch):
    monkeypatch.setattr(sparring.feed, "MISSING_S", 2.0)
    config = tmp_path / "nats.conf"
    users = "authorization {{ users: [{{ user: {}, password: p }}] }}"
    config.write_text(users.format("u"))

    async def run(nats):
        feed = sparring.feed.AsyncNatsFeed(f"nats://u:p@{nats.address}", "my-run")
        await feed._client.open()
        await feed._js.add_stream(name="SPARRING_default_FEED_my-run", subjects=["feed"])
        await feed.close()
        async with sparring.feed.AsyncNatsFeed(f"nats://u:p@{nats.address}", "my-run") as feed:
            config.write_text(users.format("other"))
            nats.reload()
            with pytest.raises(FeedError, match="the feed of the run my-run ended: NATS rejects the user"):
                await feed.receive(30)

    with NatsServer(tmp_path, "--config", config) as nats:
        asyncio.run(run(nats))
    gc.collect()


def test_missing_permission_is_explained(tmp_path, monkeypatch):
    monkeypatch.setattr(sparring.feed, "TIMEOUT_S", 2.0)
    config = tmp_path / "nats.conf"
    permissions = '{ publish: ["other.>"], subscribe: ["_INBOX_TRAINER.>"] }'
    config.write_text(f"authorization {{ users: [{{ user: u, password: p, permissions: {permissions} }}] }}")
    with NatsServer(tmp_path, "--config", config) as nats, pytest.raises(FeedError, match=r"does not permit .*consumer\.create"):
        open_nowhere(f"nats://u:p@{nats.address}")


def test_server_without_jetstream_is_named(tmp_path):
    with NatsServer(tmp_path, jetstream=False) as nats, pytest.raises(FeedError, match="start nats-server with -js"):
        open_nowhere(nats.url)


def test_server_that_does_not_answer_is_named(monkeypatch):
    monkeypatch.setattr(feed_connection, "CONNECT_S", 2.0)
    with pytest.raises(FeedError, match=r"NATS does not answer \(.*Connect call failed.*\): check `server`"):
        open_nowhere("nats://127.0.0.1:1")
