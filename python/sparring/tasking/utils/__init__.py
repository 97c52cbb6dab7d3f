"""Utilities under BSK-RL's names: orbits, attitudes, logging and helpers of classes."""
