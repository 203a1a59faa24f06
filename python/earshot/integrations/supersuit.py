# SPDX-License-Identifier: Apache-2.0
"""Several agents for SuperSuit, most of whose wrappers take one array per agent::

import supersuit
from earshot.integrations.supersuit import flat_parallel_env

env = supersuit.black_death_v3(flat_parallel_env(config))       # agents that have stopped stay, with zeros
envs = supersuit.pettingzoo_env_to_vec_env_v1(env)              # an env per agent
envs = supersuit.concat_vec_envs_v1(envs, 2, base_class="stable_baselines3")
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from .._configs import Config
from ..multi_agent import EarshotParallelEnv, Observation
from ._common import require

require("pettingzoo", "supersuit")

from pettingzoo.utils import BaseParallelWrapper  # noqa: E402


class FlatParallelEnv(BaseParallelWrapper[str, NDArray[np.float32], int]):
    """Observations of an agent in one row of float32: the sensors by name, as gymnasium's FlattenObservation orders them."""

    def __init__(self, env: EarshotParallelEnv, arguments: dict[str, Any]) -> None:
        super().__init__(env)
        self._arguments = arguments
        self._copies = 0
        self._dicts = {agent: env.observation_space(agent) for agent in env.possible_agents}
        self._boxes = {agent: spaces.utils.flatten_space(space) for agent, space in self._dicts.items()}

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy is a new env with episodes of its own: SuperSuit makes its batches of pickled copies."""
        arguments = dict(self._arguments)
        if arguments.get("first_env") is not None:
            self._copies += 1
            arguments["first_env"] += self._copies
        return _rebuild, (arguments,)

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        return self._boxes[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, Any]:
        observations, infos = self.env.reset(seed=seed, options=options)
        return self._flat(observations), infos

    def step(self, actions: dict[str, int]) -> tuple[Any, ...]:
        observations, *rest = self.env.step(actions)
        return (self._flat(observations), *rest)

    def _flat(self, observations: dict[str, Observation]) -> dict[str, NDArray[np.float32]]:
        return {agent: np.asarray(spaces.utils.flatten(self._dicts[agent], row), np.float32) for agent, row in observations.items()}


def flat_parallel_env(config: Config, **arguments: Any) -> FlatParallelEnv:
    """Arguments are those of earshot.parallel_env."""
    return _rebuild({"config": config, **arguments})


def _rebuild(arguments: dict[str, Any]) -> FlatParallelEnv:
    return FlatParallelEnv(EarshotParallelEnv(**arguments), arguments)
