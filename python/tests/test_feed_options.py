"""Arguments of feeds on NATS, without any server."""

import pytest

import sparring
from sparring.feed_options import stream_name

URL = "nats://127.0.0.1:1"


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
