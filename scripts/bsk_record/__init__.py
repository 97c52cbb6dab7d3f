"""Recorder of episodes of BSK-RL: numbers that the world `tasking` must reproduce.

`specs.py` defines the settings of an episode, `episodes/` lists the episodes by subject, `components.py` and `satellites.py`
build BSK-RL's objects from settings, `policies.py` chooses actions, `recorder.py` runs an episode and returns the recording,
and `describe.py`, `trace.py` and `encode.py` produce its parts. Start reading at `recorder.py`.
"""
