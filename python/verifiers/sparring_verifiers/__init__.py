"""Sparring for verifiers: a taskset, its harness and its environment, for `vf-eval sparring-verifiers` and prime-rl.

environment = sparring_verifiers.load_environment("http://127.0.0.1:8700", run="mine")                   # training
environment = sparring_verifiers.load_environment("http://127.0.0.1:8700", suite="kessler-heldout-v2")   # evaluation
"""

from .environment import SparringEnv, load_environment
from .harness import SparringHarness
from .session import SessionError
from .taskset import SparringTaskset

__all__ = ["SessionError", "SparringEnv", "SparringHarness", "SparringTaskset", "load_environment"]
