# SPDX-License-Identifier: Apache-2.0
"""Environments of a framework whose runners sit in processes of their own and are seeded with neighbouring numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .. import _arguments as check
from .._configs import Config
from .._seeds import drawn_seed, spread_seeds
from ..single import EarshotEnv
from ..vector import EarshotVectorEnv


class RunnerEnv(EarshotEnv):
    """Arguments are those of earshot.make.  runner: its number; envs that get the same seed in different runners differ.

    Without a seed and without first_env the episodes are drawn anew in each run.
    """

    def __init__(self, config: Config, *, runner: int = 0, first_env: int | None = None, **arguments: Any) -> None:
        super().__init__(config, first_env=first_env, **arguments)
        self._runner = check.integer(runner, "make", "runner", 0, 2**20 - 1)
        self._draws = first_env is None

    def _seed_of(self, seed: int | None) -> int | None:
        if seed is None and self._draws and not self.batch.has_started:
            seed = drawn_seed()
        return None if seed is None else spread_seeds(seed, 1, self._runner)[0]


class RunnerVectorEnv(EarshotVectorEnv):
    """Arguments are those of earshot.make_vec; env i of a seed begins that of spread_seeds."""

    def __init__(self, config: Config, num_envs: int = 1, *, first_env: int | None = None, **arguments: Any) -> None:
        super().__init__(config, num_envs, first_env=0 if first_env is None else first_env, **arguments)
        self._draws = first_env is None

    def _seeds_of(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None and self._draws and not self.batch.has_started:
            seed = drawn_seed()
        if seed is None or isinstance(seed, Sequence):
            return super()._seeds_of(seed)
        return [*spread_seeds(seed, self.num_envs, self.first_env)]
