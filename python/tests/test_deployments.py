"""Deployments: the manifests for Kubernetes and Compose are valid, and their commands have options that exist."""

import re
import subprocess
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml
from conftest import BINARY, needs_server
from documents import ROOT

#: Versions of Kubernetes whose schemas the manifests meet.
VERSIONS = ["1.31", "1.34"]
FOLDER = ROOT / "deploy/kubernetes"


def manifests() -> list[dict[str, Any]]:
    """Reads the documents of all files that the kustomization names."""
    kustomization = yaml.safe_load((FOLDER / "kustomization.yaml").read_text())
    files = {path.name for path in FOLDER.glob("*.yaml")} - {"kustomization.yaml"}
    assert files == set(kustomization["resources"])
    return [document for name in sorted(files) for document in yaml.safe_load_all((FOLDER / name).read_text())]


def pod_templates() -> dict[str, dict[str, Any]]:
    """Pod templates by the name of their stateful set or deployment."""
    workloads = [document for document in manifests() if document["kind"] in ("StatefulSet", "Deployment")]
    return {document["metadata"]["name"]: document["spec"]["template"] for document in workloads}


def commands() -> list[list[str]]:
    """Commands of `sparring` in the manifests for Kubernetes and Compose."""
    containers = [container for template in pod_templates().values() for container in template["spec"]["containers"]]
    found = [container["args"] for container in containers if container["image"] == "sparring"]
    services = yaml.safe_load((ROOT / "deploy/compose.yaml").read_text())["services"]
    found += [service["command"] for service in services.values() if service["image"] == "sparring"]
    return found


@pytest.mark.parametrize("version", VERSIONS)
def test_manifests_meet_the_schemas(version: str) -> None:
    for document in manifests():
        kubernetes_validate.validate(document, version, strict=True)


def test_unknown_fields_are_found() -> None:
    document = next(document for document in manifests() if document["kind"] == "Deployment")
    document["spec"]["replica"] = 2
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(document, VERSIONS[-1], strict=True)


def test_selectors_match_pods() -> None:
    labels = [template["metadata"]["labels"] for template in pod_templates().values()]
    names = {label["app.kubernetes.io/name"] for label in labels}
    assert names == {"nats", "server", "worker"}
    policies = [document for document in manifests() if document["kind"] == "NetworkPolicy"]
    selected = {policy["spec"]["podSelector"]["matchLabels"]["app.kubernetes.io/name"] for policy in policies}
    services = {document["metadata"]["name"] for document in manifests() if document["kind"] == "Service"}
    assert (selected, services) == (names, {"nats", "server"})


@needs_server
def test_commands_have_known_options() -> None:
    assert len(commands()) == 4
    for program, subcommand, *arguments in commands():
        assert program == "sparring"
        shown = subprocess.run([BINARY, subcommand, "--help"], capture_output=True, text=True, check=True).stdout
        for option in (argument for argument in arguments if argument.startswith("--")):
            assert re.search(rf"^\s+{option}\b", shown, re.MULTILINE), f"{subcommand} has no {option}"


def test_autoscaler_reads_a_metric_of_the_server() -> None:
    autoscaler = next(document for document in manifests() if document["kind"] == "HorizontalPodAutoscaler")
    metric = autoscaler["spec"]["metrics"][0]["external"]["metric"]["name"]
    assert f"`{metric}`" in Path(ROOT / "docs/guides/scale.md").read_text()
