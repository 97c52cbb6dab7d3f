"""The recorded results with which scripts/test-wheels compares the wheels on every interpreter."""

import importlib.util

import pytest
from documents import ROOT

pytest.importorskip("pettingzoo")


def test_environments_compute_the_recorded_results():
    spec = importlib.util.spec_from_file_location("installed_wheels", ROOT / "scripts/installed-wheels.py")
    installed_wheels = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(installed_wheels)
    installed_wheels.check_golden_results()
