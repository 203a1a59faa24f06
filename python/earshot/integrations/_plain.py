# SPDX-License-Identifier: Apache-2.0
"""A batch without gymnasium's VectorEnv, for frameworks that pin gymnasium below 1.0."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from .. import _arguments as check
from .._batch import NUM_ACTIONS, Batch, SensorArrays, open_batch
from .._configs import Config, config_text
from .._engine import InputError
from .._seeds import spread_seeds
from ._common import Observation


class PlainBatch:
    """Steps a batch whose episodes begin again in the same step; arguments are those of earshot.make_vec."""

    def __init__(
        self,
        config: Config,
        num_envs: int,
        *,
        overrides: Sequence[str] = (),
        split: str = "train",
        threads: int | None = None,
        first_env: int = 0,
    ) -> None:
        keys = {"autoreset": "same_step", "threads": threads if threads is None else check.threads(threads, "make_vec")}
        batch = open_batch(config_text(config, "make_vec"), num_envs, overrides, split, keys, first_env)
        if batch.num_agents != 1:
            raise InputError(f"agents = {batch.num_agents}: this framework takes one agent per env")
        self._batch: Batch | None = batch
        self.first_env = int(first_env)
        self.first_seed = self.first_env  #: is added to the seeds
        self.sensors = SensorArrays(batch)
        self.num_envs = batch.num_envs
        self.action_space = spaces.Discrete(NUM_ACTIONS)
        self.rewards = batch.rewards()
        self.terminated = batch.terminated().view(np.bool_)
        self.truncated = batch.truncated().view(np.bool_)
        self.quarantined = batch.quarantined().view(np.bool_)

    @property
    def batch(self) -> Batch:
        if self._batch is None:
            raise RuntimeError("this environment is closed")
        return self._batch

    def reset(self, seed: int | None = None) -> None:
        """Begins episodes in all envs: with a seed those of spread_seeds, without one the next ones."""
        self.batch.begin([] if seed is None else spread_seeds(seed, self.num_envs, self.first_seed))

    def step(self, actions: Any) -> list[dict[str, Any]]:
        """Metrics of the episodes that ended, by env; empty where none did.  quarantined: True where an episode was faulty."""
        batch = self.batch
        batch._step(check.actions(actions, self.num_envs, "step", column=True))
        ends: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for env, _, metrics in batch.finished():
            ends[env - self.first_env] = dict(metrics)
        for env in np.flatnonzero(self.quarantined).tolist():
            ends[env]["quarantined"] = True
        return ends

    def rows(self) -> Observation:
        """Copies of the observations, [num_envs, ...] by sensor."""
        return {name: array.copy() for name, array in self.sensors.rows.items()}

    def close(self) -> None:
        self._batch = None


class FlatRows:
    """All sensors in one row of float32, by name; bytes of pictures become [0, 1]."""

    def __init__(self, sensors: SensorArrays) -> None:
        self._arrays = {name: sensors.rows[name] for name in sorted(sensors.rows)}
        self.slices: dict[str, tuple[int, int, tuple[int, ...]]] = {}
        begin = 0
        for name, array in self._arrays.items():
            size = int(np.prod(array.shape[1:]))
            self.slices[name] = (begin, begin + size, array.shape[1:])
            begin += size
        self.space = spaces.Box(-np.inf, np.inf, (begin,), np.float32)

    def write(self, rows: NDArray[np.float32]) -> None:
        for name, array in self._arrays.items():
            begin, end, _ = self.slices[name]
            rows[:, begin:end] = array.reshape(len(array), -1)
            if array.dtype == np.uint8 and array.ndim == 4:
                rows[:, begin:end] /= 255
