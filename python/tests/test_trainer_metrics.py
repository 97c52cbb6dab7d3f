"""Metrics that a trainer logs about its training: stored by a real server, dropped without one."""

import http.server
import math
import threading
import time

import numpy as np
import pytest
from conftest import needs_server
from curriculum_servers import kill_server, local_curriculum, remote_curriculum, restarted_server, wait_until

import sparring
from sparring import trainer_metrics

STEPS_OF_A_BURST = 200


@pytest.fixture(scope="module")
def server():
    with local_curriculum() as owner:
        yield owner


@pytest.fixture
def curriculum(server):
    settings = {"tasks": ["kessler/survival"], "design": {"designer": "off"}}
    with sparring.Curriculum(server.url, settings=settings) as curriculum:
        yield curriculum


def stored(curriculum):
    """Returns the stored steps and values by name, after all metrics are sent."""
    curriculum.flush()
    curves = curriculum.request("GET", f"/v1/runs/{curriculum.run}/metrics?points=2000")["metrics"]
    return {curve["name"]: dict(zip(curve["step"], curve["value"], strict=True)) for curve in curves}


def dropped(caplog):
    """Returns the warnings about dropped metrics."""
    return [record.getMessage() for record in caplog.records if "metrics of the trainer are dropped" in record.getMessage()]


@needs_server
def test_metrics_are_stored_by_step(curriculum):
    curriculum.log_metrics(10, {"train/loss": 0.5, "train/kl": np.float32(0.25)})
    curriculum.log_metrics(np.int64(20), {"train/loss": 1, "train/kl": None})
    assert stored(curriculum) == {"train/loss": {10: 0.5, 20: 1.0}, "train/kl": {10: 0.25, 20: None}}


@needs_server
def test_numbers_that_are_not_finite_are_gaps(curriculum):
    curriculum.log_metrics(1, {"a": math.nan, "b": -math.inf, "c": np.float64("inf"), "d": 2.0})
    assert stored(curriculum) == {"a": {1: None}, "b": {1: None}, "c": {1: None}, "d": {1: 2.0}}


@needs_server
def test_server_accepts_the_converted_names(curriculum):
    names = ["a b", "loss (mean)", "/x//y", "_hidden", "température", "a<b>", "../up", "x" * 200, "9:1-2.3"]
    curriculum.log_metrics(0, dict.fromkeys(names, 1.0))
    expected = {"a_b", "loss__mean_", "x/y", "hidden", "temp_rature", "a_b_", "up", "x" * 128, "9:1-2.3"}
    assert stored(curriculum).keys() == expected


@needs_server
@pytest.mark.parametrize(
    ("step", "metrics", "message"),
    [
        (-1, {"loss": 1.0}, "`step` must be an integer from 0 to 9007199254740991, got -1"),
        (True, {"loss": 1.0}, "`step` must be"),
        (1.5, {"loss": 1.0}, "`step` must be"),
        (2**53, {"loss": 1.0}, "`step` must be"),
        (1, ["loss"], "`metrics` must be a mapping"),
        (1, {"loss": "high"}, r"`metrics\['loss'\]` must be a number or None, got 'high'"),
        (1, {"损失": 1.0}, "`metrics` must be named by at least one letter"),
        (1, {f"m{n}": 1.0 for n in range(101)}, "`metrics` must have at most 100 names, got 101"),
    ],
)
def test_invalid_metrics_are_named(curriculum, step, metrics, message):
    with pytest.raises(ValueError, match=message):
        curriculum.log_metrics(step, metrics)
    assert stored(curriculum) == {}


@needs_server
def test_no_metrics_send_no_request(curriculum, caplog):
    curriculum.log_metrics(1, {})
    assert stored(curriculum) == {} and dropped(caplog) == []


@needs_server
def test_calls_beyond_the_rate_are_dropped_with_one_warning(curriculum, caplog):
    longest = 0.0
    for step in range(STEPS_OF_A_BURST):
        started = time.monotonic()
        curriculum.log_metrics(step, {"loss": step})
        longest = max(longest, time.monotonic() - started)
        time.sleep(0.002)
    steps = stored(curriculum)["loss"]
    assert 15 <= len(steps) < STEPS_OF_A_BURST
    assert longest < 5.0, "no call waits for the server"
    reasons = dropped(caplog)
    assert 1 <= len(reasons) <= 2, "one warning for the rate, at most one for waiting requests"
    assert len(set(reasons)) == len(reasons)


@needs_server
def test_metrics_beyond_a_hundred_of_a_run_are_dropped(curriculum, caplog):
    curriculum.log_metrics(1, {f"m{n}": n for n in range(100)})
    for step in (2, 3):
        curriculum.log_metrics(step, {"one_more": 1.0})
        curriculum.flush()
    assert len(stored(curriculum)) == 100
    assert len(dropped(caplog)) == 1 and "100" in dropped(caplog)[0]


@needs_server
def test_outage_is_a_warning_and_logging_continues_after_it(tmp_path, caplog):
    owner, curriculum = remote_curriculum(db=tmp_path / "it.sqlite3")
    curriculum.log_metrics(1, {"loss": 1.0})
    curriculum.flush()
    kill_server(owner)
    for step in (2, 3, 4):
        curriculum.log_metrics(step, {"loss": 1.0})
        curriculum._metrics.flush(60.0)
    assert len(dropped(caplog)) == 1 and "no server answers" in dropped(caplog)[0]
    with restarted_server(tmp_path / "it.sqlite3", curriculum.url):
        curriculum.wait_for_server()
        curriculum.log_metrics(5, {"loss": 2.0})
        assert stored(curriculum) == {"loss": {1: 1.0, 5: 2.0}}
    curriculum.close()


@needs_server
def test_close_sends_the_last_metrics(server):
    curriculum = sparring.Curriculum(server.url, server.run)
    curriculum.log_metrics(7, {"last": 1.0})
    curriculum.close()
    assert stored(server)["last"] == {7: 1.0}


def test_silent_server_never_delays_a_training(caplog):
    release, begun = threading.Event(), threading.Event()

    def send(_):
        begun.set()
        release.wait()

    sender = trainer_metrics.MetricsSender(send)
    started = time.monotonic()
    for step in range(100):
        sender.add(str(step))
    sender.flush(0.0)
    assert time.monotonic() - started < 5.0 and sender.is_busy
    assert begun.wait(60.0)
    assert len(dropped(caplog)) == 1 and "20 requests already wait" in dropped(caplog)[0]
    release.set()
    sender.flush(60.0)
    wait_until(lambda: not sender.is_busy)


def test_older_server_is_a_warning(caplog):
    class Handler(http.server.BaseHTTPRequestHandler):
        def do_POST(self):
            self.rfile.read(int(self.headers["Content-Length"]))
            self.send_response(404)
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, *_):
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        client = sparring._native.NativeHttpClient(f"http://127.0.0.1:{server.server_port}")
        sender = trainer_metrics.MetricsSender(
            lambda request: client.request("POST", "/v1/runs/r/metrics", request, max_wait_s=0.0)
        )
        for _ in range(3):
            sender.add("{}")
            sender.flush(60.0)
        server.shutdown()
    assert len(dropped(caplog)) == 1 and "404" in dropped(caplog)[0]


class Target:
    """Target that records its calls."""

    def __init__(self):
        self.calls = []

    def log_metrics(self, step, metrics):
        self.calls.append((step, dict(metrics)))


def test_report_has_only_the_trainers_numbers():
    target = Target()
    values = {
        "loss": 1,
        "kl": np.float32(0.5),
        "text": "high",
        "flag": True,
        "none": None,
        "curriculum/x/level": 3.0,
        "损失": 1.0,
    }
    trainer_metrics.TrainerReport(target).add(4, values)
    assert target.calls == [(4, {"loss": 1, "kl": np.float32(0.5)})]


def test_report_skips_calls_and_finish_sends_the_last():
    target = Target()
    report = trainer_metrics.TrainerReport(target, interval_s=3600.0)
    for step in range(5):
        report.add(step, {"loss": step})
    assert target.calls == [(0, {"loss": 0})]
    report.finish()
    report.finish()
    assert target.calls == [(0, {"loss": 0}), (4, {"loss": 4})]


def test_report_of_too_many_numbers_is_cut_with_one_warning(caplog):
    target = Target()
    report = trainer_metrics.TrainerReport(target, interval_s=0.0)
    for step in range(3):
        report.add(step, {f"m{n:03}": 1.0 for n in range(120)})
    assert [len(metrics) for _, metrics in target.calls] == [100, 100, 100]
    assert caplog.text.count("a run stores 100 metrics, the trainer has 120") == 1


def test_report_never_ends_a_training(caplog):
    class Foreign:
        def log_metrics(self, step, metrics):
            raise sparring.CurriculumError("the curriculum belongs to another process")

    report = trainer_metrics.TrainerReport(Foreign(), interval_s=0.0)
    report.add(1, {"loss": 1.0})
    report.add(2, {"loss": 1.0})
    assert caplog.text.count("belongs to another process") == 1


@pytest.mark.parametrize("target", [None, object()])
def test_report_without_a_run_does_nothing(target):
    report = trainer_metrics.TrainerReport(target)
    report.add(1, {"loss": 1.0})
    report.finish()
