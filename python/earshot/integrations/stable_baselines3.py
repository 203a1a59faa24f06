# SPDX-License-Identifier: Apache-2.0
"""A batch as a VecEnv of Stable-Baselines3::

from stable_baselines3 import PPO
from earshot.integrations.stable_baselines3 import EarshotVecEnv

PPO("MultiInputPolicy", EarshotVecEnv("earshot:train/quick", 16, threads=0)).learn(100_000)
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _arguments as check
from .._configs import Config
from .._seeds import spread_seeds
from ..vector import EarshotVectorEnv
from ._common import Observation, end_of, require

require("stable_baselines3", "sb3")

from stable_baselines3.common.vec_env import VecEnv  # noqa: E402

Indices = int | Iterable[int] | None


class EarshotVecEnv(VecEnv):
    """Arguments are those of earshot.make_vec; episodes begin again in the same step, as Stable-Baselines3 asks.

    The info of the last step of an episode has terminal_observation, TimeLimit.truncated, episode {r, l} as Monitor writes it, and the
    metrics of Earshot (success, spl, ...).  Observations are copies.  is_success stands beside success: the framework logs its rate.
    """

    def __init__(self, config: Config, num_envs: int = 1, **arguments: Any) -> None:
        self.envs = EarshotVectorEnv(config, num_envs, autoreset_mode="same_step", copy=True, **arguments)
        self._actions: NDArray[Any] | None = None
        super().__init__(num_envs, self.envs.single_observation_space, self.envs.single_action_space)

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seeds of the next reset: n * 2**20 + i for env i, so that neighbouring n share no episodes.  None: drawn from NumPy's."""
        first = super().seed(seed)[0]
        self._seeds = list(spread_seeds(first, self.num_envs, self.envs.first_env, "seed"))
        return self._seeds

    def reset(self) -> Observation:
        """Begins episodes in all envs; after seed(n) those of spread_seeds."""
        seeds = self._seeds if any(seed is not None for seed in self._seeds) else None
        observations, _ = self.envs.reset(seed=seeds)
        self.reset_infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        self._actions = check.array(actions, "step_async", "actions", f"[{self.num_envs}] integers")

    def step_wait(self) -> tuple[Observation, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        if self._actions is None:
            raise RuntimeError("step_wait() needs step_async(actions) before it")
        observations, rewards, terminated, truncated, infos = self.envs.step(self._actions)
        self._actions = None
        ended = terminated | truncated
        listed: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for env in np.flatnonzero(ended).tolist():
            info = end_of(infos["final_info"], env)
            if "episode_return" in info:
                info["episode"] = {"r": info["episode_return"], "l": info["steps"]}
                info["is_success"] = info["success"] > 0
            if "quarantined" in infos and infos["quarantined"][env]:
                info["quarantined"] = True
            info["terminal_observation"] = infos["final_obs"][env]
            info["TimeLimit.truncated"] = bool(truncated[env] and not terminated[env])
            listed[env] = info
        return observations, rewards, ended, listed

    def close(self) -> None:
        self.envs.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        return self.envs.render() or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        return [getattr(self.envs.envs[env], attr_name) for env in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        for env in self._get_indices(indices):
            setattr(self.envs.envs[env], attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any) -> list[Any]:
        return [getattr(self.envs.envs[env], method_name)(*method_args, **method_kwargs) for env in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Indices = None) -> list[bool]:
        """RecordEpisodeStatistics and Monitor are not needed: infos have what they write."""
        return [wrapper_class.__name__ == "Monitor" for _ in self._get_indices(indices)]
