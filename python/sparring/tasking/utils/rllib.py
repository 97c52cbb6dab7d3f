"""Help for RLlib, under the name of `bsk_rl.utils.rllib`; callbacks and connectors are left out."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

from ..unsupported import missing_names, sentence

_DISCOUNT = "discount by time with sparring.discounting and info['d_ts']"
_LOG = "log what you need in a callback of your own"
_CALLBACKS = ("EpisodeDataCallbacks", "MultiagentEpisodeDataCallbacks", "WrappedEpisodeDataCallbacks")
_LOGGERS = ("EpisodeDataLogger", "EpisodeDataWrapper", "EpisodeDataParallelWrapper")


def unpack_config(env: type) -> type:
    """Returns a class of environments whose constructor takes the `env_config` of RLlib."""

    class UnpackedEnvironment(env):  # type: ignore[misc]
        """Environment with the arguments of a configuration."""

        def __init__(self, env_config: dict[str, Any]) -> None:
            super().__init__(**deepcopy(dict(env_config)))

    UnpackedEnvironment.__name__ = f"{env.__name__}_Unpacked"
    return UnpackedEnvironment


_get_missing = missing_names(
    __name__,
    {
        **{name: sentence(name, _LOG) for name in (*_CALLBACKS, *_LOGGERS)},
        "discounting": sentence("utils.rllib.discounting", _DISCOUNT),
        "load_torch_mlp_policy": sentence("load_torch_mlp_policy", "load the module with RLlib"),
    },
)


def __getattr__(name: str) -> Any:
    return _get_missing(name)
