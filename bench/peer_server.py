"""OpenEnv server of openenv-core, as the peer of `bench sockets`.

    python3 bench/peer_server.py --port 0 [--kessler-env path]

It serves a copy of the public kessler-env, if one is given. Otherwise it serves an environment that does nothing: every step has
the same observation, with the form and size of the public environment's, so that the original can only be slower. The first line
on stdout is the port.
"""

import argparse
import pathlib
import socket

import uvicorn
from openenv.core.env_server.http_server import create_fastapi_app
from openenv.core.env_server.interfaces import Environment
from openenv.core.env_server.types import Action, Observation, State
from pydantic import BaseModel, Field

import peers

#: Steps of an episode.
STEPS = 50
#: Pieces of debris of an observation.
DEBRIS = 25


class Burn(BaseModel):
    satellite_id: int
    delta_vx: float
    delta_vy: float


class IdleAction(Action):
    burns: list[Burn] = Field(default_factory=list)


class Body(BaseModel):
    id: int
    x: float
    y: float
    vx: float
    vy: float


class Satellite(Body):
    status: str
    fuel: float


class IdleObservation(Observation):
    mission_objective: str = ""
    target_radius: float = 0.0
    satellites: list[Satellite] = Field(default_factory=list)
    radar_debris: list[Body] = Field(default_factory=list)
    radar_range: float = 0.0
    critical_alerts: list[str] = Field(default_factory=list)
    total_score: float = 0.0


class IdleEnvironment(Environment):
    """Environment in which nothing moves, with episodes as long as the original's."""

    SUPPORTS_CONCURRENT_SESSIONS = True

    def __init__(self):
        super().__init__()
        self._state = State(episode_id="idle", step_count=0)

    def _observe(self) -> IdleObservation:
        state = {"x": 51.73205080756888, "y": -12.360679774997898, "vx": 0.8414709848078965, "vy": 3.9092974268256817}
        return IdleObservation(
            mission_objective="SURVIVAL: Keep all satellites alive and out of debris paths.",
            satellites=[Satellite(id=i, status="active", fuel=98.76543209876543, **state) for i in range(3)],
            radar_debris=[Body(id=100 + i, **state) for i in range(DEBRIS)],
            total_score=0.51896,
            reward=0.01996,
            done=self._state.step_count >= STEPS,
        )

    def reset(self, seed=None, episode_id=None, **_):
        self._state = State(episode_id=episode_id or "idle", step_count=0)
        return self._observe()

    def step(self, action, timeout_s=None, **_):
        self._state.step_count += 1
        return self._observe()

    @property
    def state(self) -> State:
        return self._state


def make_application(root: str):
    """Makes the application of a copy of the public environment, or of the idle one."""
    if not root:
        return create_fastapi_app(IdleEnvironment, IdleAction, IdleObservation, max_concurrent_envs=64)
    environment = peers.load(pathlib.Path(root).resolve())
    environment.SUPPORTS_CONCURRENT_SESSIONS = True
    action, observation = peers.action_type(environment), peers.observation_type(environment)
    return create_fastapi_app(environment, action, observation, max_concurrent_envs=64)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--port", type=int, default=0)
    parser.add_argument("--kessler-env", default="")
    args = parser.parse_args()
    listener = socket.create_server(("127.0.0.1", args.port))
    print(listener.getsockname()[1], flush=True)
    # No compression, as on the other side: the clients do not offer it.
    config = uvicorn.Config(make_application(args.kessler_env), log_level="warning", ws_per_message_deflate=False)
    uvicorn.Server(config).run(sockets=[listener])


if __name__ == "__main__":
    main()
