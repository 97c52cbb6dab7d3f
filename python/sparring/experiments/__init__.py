"""Experiments: `ppo` trains a policy, `curriculum` compares the curricula that train it.

`ppo` is the learner and `ppo_cli` its command line. Of the comparison, `cli` is the command line, `experiment` defines what is
compared, `runner` runs all trainings, `training` runs one of them, `results` reads their files, and `report` writes tables and
pictures.
"""
