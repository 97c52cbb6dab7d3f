"""Arguments of feeds on NATS, without any server."""

import re

import pytest

import sparring
from sparring.feed_options import MAX_DURATION_S, MIN_DURATION_S, stream_name

URL = "nats://127.0.0.1:1"
#: Seed of an nkey from the documentation of NATS.
SEED = "SUACSSL3UAHUDXKFSNVUZRF5UHPMWZ6BFDTJ7M6USDXIEDNPPQYYYCU3VY"
CREDENTIALS = (
    "-----BEGIN NATS USER JWT-----\neyJ0eXAi\n------END NATS USER JWT------\n\n"
    "-----BEGIN USER NKEY SEED-----\n{}\n------END USER NKEY SEED------\n"
)


def test_runs_have_streams_of_their_own():
    assert stream_name("default", "my-run") == "SPARRING_default_FEED_my-run"
    assert stream_name("team-7", "a_b") == "SPARRING_team-7_FEED_a_b"
    assert stream_name("default", "east.my-run") == "SPARRING_default_FEED-east_my-run"
    runs = ["my-run", "east_my-run", "east.my-run", "east.-my_run", "east-my.run", "-east_my-run"]
    assert len({stream_name("default", run) for run in runs}) == len(runs)


@pytest.mark.parametrize("run", ["my-run", "a" * 64, "east.my-run", f"{'e' * 16}.{'a' * 64}", "0._"])
def test_id_of_a_run_is_accepted(run):
    pytest.importorskip("nats")
    assert sparring.feed.AsyncNatsFeed(URL, run)._run == run


@pytest.mark.parametrize(
    "run",
    ["", ".", "My-run", "a" * 65, ".my-run", "east.", "East.run", "ea-st.run", "a.b.c", f"{'e' * 17}.run", "a b", "run\n", 3],
)
def test_invalid_id_of_a_run_is_rejected(run):
    with pytest.raises(ValueError, match=r"^`run` must be the id of a run, such as my-run, or east\.my-run with a shard, got"):
        sparring.feed.nats(URL, run)


@pytest.mark.parametrize(
    ("argument", "value", "requirement"),
    [
        ("consumer", "a.b", r"1 to 64 letters, digits, `-` or `_`, got 'a\.b'"),
        ("cluster", "c" * 33, "1 to 32 letters"),
        ("idle_s", 0, "a number of seconds > 0, or None"),
        ("idle_s", float("nan"), "a number of seconds > 0, or None"),
        *(
            (argument, value, f"a number of seconds from {MIN_DURATION_S} to {MAX_DURATION_S}")
            for argument in ("ack_wait_s", "forget_after_s")
            for value in (0, -1.0, 1e-9, 0.99, 1e300, float("inf"), float("nan"), 10**400, True, "30", None, MAX_DURATION_S + 1)
        ),
    ],
)
def test_invalid_argument_is_named(argument, value, requirement):
    arguments = {"server": URL, "run": "my-run", argument: value}
    with pytest.raises(ValueError, match=f"^`{argument}` must be {requirement}"):
        sparring.feed.nats(**arguments)


@pytest.mark.parametrize(
    ("server", "fault"),
    [
        ("", "an address is missing"),
        ("nats://a,", "an address is missing"),
        ("127.0.0.1:4222", "it must begin with nats:// or tls://"),
        ("http://127.0.0.1:8700", "it must begin with nats:// or tls://"),
        ("ws://127.0.0.1:4222", "it must begin with nats:// or tls://"),
        ("tls://a,wss://b", "it must begin with nats:// or tls://"),
        ("nats://[::1", "the host is invalid"),
        ("nats://", "the host is missing"),
        ("nats://:4222", "the host is missing"),
        ("nats://::1", "the port must be a number from 1 to 65535"),
        ("nats://a b", "it must have no spaces"),
        ("nats://a\n", None),
        ("nats://127.0.0.1:0", "the port must be a number from 1 to 65535"),
        ("nats://127.0.0.1:99999", "the port must be a number from 1 to 65535"),
        ("nats://a:1,nats://b:abc", "the port must be a number from 1 to 65535"),
        ("nats://user:p%40ss@a", "the user and the password may have letters, digits and `-._~` only; else set `credentials`"),
        ("nats://a:1/b", "it must end after the port"),
        ("nats://a?tls=1", "it must end after the port"),
        ("nats://a,nats://b:1 , tls://u:p@[::1]:4222", None),
    ],
)
def test_each_address_is_checked(server, fault):
    pytest.importorskip("nats")
    if fault is None:
        sparring.feed.AsyncNatsFeed(server, "my-run")
        return
    requirement = rf"an address such as nats://\S+ or tls://\S+ \({re.escape(fault)}\)"
    with pytest.raises(ValueError, match=rf"^`server` must be {requirement}, got '"):
        sparring.feed.nats(server, "my-run")


@pytest.mark.parametrize("scheme", ["nats://", "http://", ""])
@pytest.mark.parametrize("password", ["pw", "pw#pw", "pw/pw", "pw,pw", "pw@pw"])
def test_invalid_address_is_shown_without_password(scheme, password):
    with pytest.raises(ValueError, match=rf"^`server` must be .* got '{scheme}…@a:b'$") as error:
        sparring.feed.nats(f"{scheme}user:{password}@a:b", "my-run")
    assert "pw" not in str(error.value)


def test_list_of_addresses_is_refused_without_its_password():
    with pytest.raises(ValueError, match=r"^`server` must be an address such as .* got <class 'list'>$"):
        sparring.feed.nats(["nats://user:pw@a"], "my-run")


@pytest.mark.parametrize("argument", ["credentials", "ca_file"])
def test_file_that_cannot_be_used_is_named(argument, tmp_path):
    pytest.importorskip("nats")
    contents = {
        "empty": b"",
        "binary": b"\xff\xfe\x00",
        "jwt": CREDENTIALS.split("\n\n")[0].encode(),
        "typing-error": SEED.replace("UDX", "UDY").encode(),
        "two-lines": f"{SEED}\nUB\n".encode(),
        "wrong-seed": CREDENTIALS.format("SUA").encode(),
        "no-certificate": b"-----BEGIN CERTIFICATE-----\nnone\n-----END CERTIFICATE-----\n",
    }
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
    requirement = {"credentials": r"a \.creds file", "ca_file": "a PEM file"}[argument]
    for name in [*contents, "missing", "."]:
        with pytest.raises(ValueError, match=rf"^`{argument}` must be {requirement} .*\(.+\), got .*{name}'\)?$"):
            sparring.feed.nats(URL, "my-run", **{argument: tmp_path / name if name != "." else f"{tmp_path}/."})
    with pytest.raises(ValueError, match=f"^`{argument}` must be {requirement}"):
        sparring.feed.nats(URL, "my-run", **{argument: 5})


@pytest.mark.parametrize("content", [SEED, f"\n{SEED}\r\n", CREDENTIALS.format(SEED)])
def test_credentials_are_accepted(content, tmp_path):
    pytest.importorskip("nkeys")
    (tmp_path / "file").write_text(content)
    sparring.feed.AsyncNatsFeed(URL, "my-run", credentials=tmp_path / "file")
