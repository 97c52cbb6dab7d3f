"""Simulated clusters of Ray: several nodes on this machine, each with processes and resources of its own."""

import contextlib
import os
import sys
import time
from pathlib import Path

import pytest
import ray
from ray.cluster_utils import Cluster

#: Custom resource of the nodes that run env runners and actors; the head has none.
RUNNER = "sparring_runner"


class SimulatedCluster:
    """Cluster with a head for the driver and learner, and nodes with room for one env runner each."""

    def __init__(self, nodes):
        head = {"num_cpus": 2, "include_dashboard": False, "object_store_memory": 100 * 2**20}
        self._cluster = Cluster(initialize_head=True, head_node_args=head)
        self.nodes = [self.add_node() for _ in range(nodes)]
        ray.init(self._cluster.address, log_to_driver=False)

    def add_node(self):
        """Starts a node and returns it."""
        return self._cluster.add_node(num_cpus=1, resources={RUNNER: 1}, object_store_memory=80 * 2**20)

    def kill_node(self, node_id, pid):
        """Kills the raylet of a node, without a stop of its processes, and waits until a process of it has ended."""
        (node,) = [node for node in self._cluster.worker_nodes if node.node_id == node_id]
        self._cluster.remove_node(node, allow_graceful=False)
        deadline = time.monotonic() + 30
        while is_running(pid):
            assert time.monotonic() < deadline, f"process {pid} survives its node"
            time.sleep(0.05)

    def shutdown(self):
        """Ends the connection of the driver, and all nodes."""
        ray.shutdown()
        self._cluster.shutdown()


@contextlib.contextmanager
def simulated_cluster(nodes=2):
    """Starts a cluster, connects the driver to its head, and stops it at the end of the block."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        # The processes of the nodes import the modules of the tests.
        folders = [*(os.fspath(Path(__file__).parents[up]) for up in range(3)), *filter(None, sys.path)]
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join(folders))
        cluster = SimulatedCluster(nodes)
        try:
            yield cluster
        finally:
            cluster.shutdown()


def is_running(pid):
    """Returns True while a process exists that has not ended."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def place():
    """Returns the node and the process of the caller."""
    return ray.get_runtime_context().get_node_id(), os.getpid()
