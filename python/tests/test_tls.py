"""Clients of a server with TLS, under a certificate authority of the test."""

import asyncio
import re
import subprocess

import pytest
from conftest import BINARY, needs_server
from curriculum_servers import SETTINGS
from tls_files import create_tls_files

import sparring

pytestmark = needs_server


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return create_tls_files(tmp_path_factory.mktemp("tls"))


@pytest.fixture(scope="module")
def url(files):
    command = [BINARY, "serve", "--bind", "127.0.0.1:0", "--temporary", "--while-stdin"]
    command += ["--tls-cert", files / "cert.pem", "--tls-key", files / "key.pem"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        assert server.stdin is not None and server.stdout is not None
        match = re.search(r"https://\S+", server.stdout.readline())
        assert match is not None
        yield match[0]
        server.stdin.close()


def test_clients_trust_the_given_authority(url, files, monkeypatch):
    monkeypatch.delenv("SPARRING_CA_FILE", raising=False)
    with sparring.Client(url, ca_file=files / "ca.pem") as client:
        run = client.runs.create(**SETTINGS)["id"]

    async def read():
        async with sparring.AsyncClient(url, ca_file=str(files / "ca.pem")) as client:
            return await client.runs.get(run)

    assert asyncio.run(read())["id"] == run
    with sparring.Client(url, retry_timeout_s=0) as client, pytest.raises(sparring.ServerUnreachableError, match="CERTIFICATE"):
        client.runs.get(run)
    with pytest.raises(ValueError, match="`ca_file` must be a PEM file with certificates"):
        sparring.Client(url, ca_file=files / "none.pem")


def test_curriculum_trusts_the_authority_of_the_variable(url, files, monkeypatch):
    monkeypatch.setenv("SPARRING_CA_FILE", str(files / "ca.pem"))
    with sparring.Curriculum(url, settings=SETTINGS) as curriculum, sparring.Client(url) as client:
        assert client.runs.get(curriculum.run)["id"] == curriculum.run
    monkeypatch.setenv("SPARRING_CA_FILE", str(files / "none.pem"))
    with pytest.raises(ValueError, match=r"SPARRING_CA_FILE: the file .*none\.pem cannot be used"):
        sparring.Curriculum(url, settings=SETTINGS)
