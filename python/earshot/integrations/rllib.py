# SPDX-License-Identifier: Apache-2.0
"""Environments for RLlib, single and as a batch::

    from earshot.integrations.rllib import register

    name = register("quick", "earshot:train/quick")
    PPOConfig().environment(name).env_runners(num_envs_per_env_runner=16, gym_env_vectorize_mode="vector_entry_point")

Observations are one row of float32, which every default network of RLlib takes; flatten=False gives the dict of sensors, for a module
of one's own.
"""

from __future__ import annotations

from typing import Any

import gymnasium

from .._configs import Config
from ..single import EarshotEnv
from ..vector import EarshotVectorEnv
from ._common import require

require("ray", "rllib")

from ray.tune.registry import register_env  # noqa: E402


def make_env(config: Config, *, flatten: bool = True, **arguments: Any) -> gymnasium.Env[Any, Any]:
    """One env; arguments are those of earshot.make."""
    env: gymnasium.Env[Any, Any] = EarshotEnv(config, **arguments)
    return gymnasium.wrappers.FlattenObservation(env) if flatten else env


def make_vec(config: Config, num_envs: int, *, flatten: bool = True, **arguments: Any) -> gymnasium.vector.VectorEnv[Any, Any, Any]:
    """A batch whose episodes begin in the step after an end, as RLlib asks; arguments are those of earshot.make_vec."""
    envs = EarshotVectorEnv(config, num_envs, autoreset_mode="next_step", copy=True, **arguments)
    return gymnasium.wrappers.vector.FlattenObservation(envs) if flatten else envs


def register(name: str, config: Config, **arguments: Any) -> str:
    """Registers a config under a name for AlgorithmConfig.environment(); keys of env_config replace arguments.

    With gym_env_vectorize_mode="vector_entry_point" a runner steps one batch, else as many single envs.  Runner i gets episodes of its own.
    """

    def create(context: Any) -> Any:
        keys = {**arguments, **dict(context)}
        num_envs = keys.pop("num_envs", None)
        runner = getattr(context, "worker_index", 0)
        if num_envs is None:
            return make_env(keys.pop("config", config), **keys)
        return make_vec(keys.pop("config", config), num_envs, **{"first_env": runner * num_envs, **keys})

    register_env(name, create)
    return name
