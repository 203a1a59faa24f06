# SPDX-License-Identifier: Apache-2.0
"""A batch as a native environment of PufferLib::

    import pufferlib.vector
    from earshot.integrations.pufferlib import EarshotPufferEnv

    keys = {"config": "earshot:train/quick", "num_envs": 16}
    envs = pufferlib.vector.make(EarshotPufferEnv, env_kwargs=keys, backend=pufferlib.PufferEnv)

Observations are one row of float32 per env: the sensors by name, at `slices`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _arguments as check
from .._configs import Config
from ._common import require
from ._plain import FlatRows, PlainBatch

pufferlib = require("pufferlib", "puffer", at_least=3)


class EarshotPufferEnv(pufferlib.PufferEnv):  # type: ignore[name-defined]
    """Arguments are those of earshot.make_vec; episodes begin again in the same step.  Infos: the metrics of the episodes that ended.

    buf, seed: PufferLib's, which numbers its envs by the seed.  Envs of different numbers share no episodes whatever the seeds of their
    resets; the first reset without a seed takes the number, later ones go on.
    """

    def __init__(self, config: Config, num_envs: int = 1, buf: Any = None, seed: int | None = 0, **arguments: Any) -> None:
        self._number = 0 if seed is None else check.seed(seed, "EarshotPufferEnv")
        self.plain = PlainBatch(config, num_envs, **arguments)
        num_envs = self.plain.num_envs
        self.plain.first_seed = self.plain.first_env + self._number * num_envs
        self.flat = FlatRows(self.plain.sensors)
        self.slices = self.flat.slices
        self.single_observation_space = self.flat.space
        self.single_action_space = self.plain.action_space
        self.num_agents = num_envs
        super().__init__(buf)

    def reset(self, seed: int | None = None) -> tuple[NDArray[np.float32], list[dict[str, Any]]]:
        if seed is None and not self.plain.batch.has_started:
            seed = self._number
        self.plain.reset(seed)
        self.flat.write(self.observations)
        return self.observations, []

    def step(self, actions: Any) -> tuple[Any, ...]:
        ends = self.plain.step(actions)
        self.flat.write(self.observations)
        self.rewards[:] = self.plain.rewards
        self.terminals[:] = self.plain.terminated
        self.truncations[:] = self.plain.truncated
        return self.observations, self.rewards, self.terminals, self.truncations, [end for end in ends if end]

    def close(self) -> None:
        self.plain.close()
