# SPDX-License-Identifier: Apache-2.0
"""What can be asked of one environment by name: the same of a single one and of each one of a batch."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _rendering
from ._engine_batch import Batch


class Episode:
    """State of the episode that runs in one env; `_env_row` is its row in the batch."""

    _env_row: int = 0

    @property
    def batch(self) -> Batch:
        raise NotImplementedError

    @property
    def pose(self) -> tuple[float, float, float, float]:
        """Foot point x, y, z in metres, in the coordinates of the scene's file, and heading in radians, counter-clockwise from -z."""
        return self.batch.pose(self._env_row)

    @property
    def scene_name(self) -> str:
        return self.batch.scene_name(self._env_row)

    @property
    def episode_index(self) -> int:
        """Number of the episode in its set."""
        return self.batch.episode_index(self._env_row)

    def snapshot(self) -> bytes:
        """State of the env; restore() goes on from it with the same bits, in any env with the same episodes and config."""
        return self.batch.snapshot(self._env_row)

    def restore(self, state: bytes) -> None:
        self.batch.restore(self._env_row, state)


ENV_OF_BATCH_NAMES = frozenset({"_envs", "_env_row"})  #: attributes of an EnvOfBatch that are not the user's


class EnvOfBatch(Episode):
    """One env of a batch, as `call`, `get_attr` and `set_attr` of the batch see it.

    It holds attributes that the user sets.  Those of the engine cannot be set: they follow from the config and the actions.
    """

    def __init__(self, envs: Any, row: int) -> None:
        self._envs = envs
        self._env_row = row

    @property
    def batch(self) -> Batch:
        batch: Batch = self._envs.batch
        return batch

    @property
    def unwrapped(self) -> EnvOfBatch:
        return self

    @property
    def observation_space(self) -> Any:
        return self._envs.single_observation_space

    @property
    def action_space(self) -> Any:
        return self._envs.single_action_space

    @property
    def metadata(self) -> dict[str, Any]:
        metadata: dict[str, Any] = self._envs.metadata
        return metadata

    @property
    def render_mode(self) -> str | None:
        mode: str | None = self._envs.render_mode
        return mode

    @property
    def spec(self) -> Any:
        return self._envs.spec

    def render(self) -> NDArray[np.uint8]:
        """A frame of this env; needs a render mode."""
        rows: dict[str, NDArray[Any]] = self._envs.sensor_row(self._env_row)
        return _rendering.draw(rows)

    def __getattr__(self, name: str) -> Any:
        names = [name for name in dir(self) if not name.startswith("_")]
        raise AttributeError(f"an env of the batch has no attribute {name!r}; it has {', '.join(names)}")

    def __setattr__(self, name: str, value: Any) -> None:
        if not name.startswith("_") and hasattr(type(self), name):
            raise AttributeError(f"{name!r} of an env of the batch cannot be set: it follows from the config and the actions")
        super().__setattr__(name, value)


def private_names(env: object) -> frozenset[str]:
    """Attributes that an env has made for itself from the engine."""
    return frozenset(name for name in [*vars(env), "_of_engine"] if name.startswith("_"))


def attributes_beside(env: object, of_engine: Collection[str]) -> dict[str, Any]:
    """The other ones, such as spec, the generators of gymnasium and of spaces, and what set_attr gave."""
    return {name: value for name, value in vars(env).items() if name not in of_engine}
