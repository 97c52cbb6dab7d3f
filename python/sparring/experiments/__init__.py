"""Experiments that are run, not read about: `ppo` trains, `curriculum` compares what it is trained by."""
