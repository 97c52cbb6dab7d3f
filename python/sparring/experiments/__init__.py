"""Experiments: `ppo` trains a policy, `curriculum` compares the curricula that train it.

`ppo` is the learner and `ppo_cli` its command line; `grpo` and `sb3_ppo` are further learners, of the evidence runs. The
comparison starts at its command line, `cli`. `experiment` defines it, `runner` runs all trainings, and `training` runs one of
them. `results` reads their files, and `report` writes tables and pictures.
"""
