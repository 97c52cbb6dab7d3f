import os

import gymnasium
import numpy as np
import pytest

import sparring

#: The program whose server tests start.
BINARY = os.environ.get("SPARRING_BINARY") or os.environ.get("SPARRING_BIN")
#: `make test-python` and the others build it and name it: there nothing is left out.
served = pytest.mark.skipif(not BINARY, reason="SPARRING_BINARY names no program: build it, or run make test-python")


@pytest.fixture(params=sorted(sparring.ENVIRONMENTS))
def id(request):
    return request.param


@pytest.fixture(params=sorted(sparring.ENVIRONMENTS.values()))
def task(request):
    return request.param


def equal(a, b):
    """Observations or infos that are the same to the bit."""
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(equal(a[key], b[key]) for key in a)
    a, b = np.asarray(a), np.asarray(b)
    if a.dtype == object:
        return a.shape == b.shape and all(
            (x is None and y is None) or equal(x, y) for x, y in zip(a.ravel(), b.ravel(), strict=True)
        )
    return a.shape == b.shape and a.dtype == b.dtype and a.tobytes() == b.tobytes()


def short(task):
    """Params by which episodes end early now and then, so that resets are seen."""
    if task.startswith("docking"):
        return {"start_radius": 10.0, "time_limit_s": 60.0}
    return {"debris": 120.0, "spread": 1.0}


__all__ = ["BINARY", "equal", "gymnasium", "served", "short"]
