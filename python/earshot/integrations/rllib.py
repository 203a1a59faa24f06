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
from ._common import require
from ._runners import RunnerEnv, RunnerVectorEnv

require("ray", "rllib")

from ray.tune.registry import register_env  # noqa: E402


def make_env(config: Config, *, flatten: bool = True, **arguments: Any) -> gymnasium.Env[Any, Any]:
    """One env; arguments are those of earshot.make, and `runner`, the number of the runner."""
    env: gymnasium.Env[Any, Any] = RunnerEnv(config, **arguments)
    return gymnasium.wrappers.FlattenObservation(env) if flatten else env


def make_vec(config: Config, num_envs: int, *, flatten: bool = True, **arguments: Any) -> gymnasium.vector.VectorEnv[Any, Any, Any]:
    """A batch whose episodes begin in the step after an end, as RLlib asks; arguments are those of earshot.make_vec."""
    envs = RunnerVectorEnv(config, num_envs, autoreset_mode="next_step", copy=True, **arguments)
    return gymnasium.wrappers.vector.FlattenObservation(envs) if flatten else envs


def register(name: str, config: Config, **arguments: Any) -> str:
    """Registers a config under a name for AlgorithmConfig.environment(); keys of env_config replace arguments.

    With gym_env_vectorize_mode="vector_entry_point" a runner steps one batch, else as many single envs.  Each env of each runner gets
    episodes of its own, with AlgorithmConfig.debugging(seed=) the same in each run.
    """

    def create(context: Any) -> Any:
        keys = {**arguments, **dict(context)}
        num_envs = keys.pop("num_envs", None)
        if num_envs is None:
            return make_env(keys.pop("config", config), **{"runner": getattr(context, "worker_index", None) or 0, **keys})
        return make_vec(keys.pop("config", config), num_envs, **keys)  # RLlib gives no number of the runner here

    register_env(name, create)
    return name
