# SPDX-License-Identifier: Apache-2.0
"""A batch of the engine with its arrays and spaces, shared by the vector environment and the multi-agent environment."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from . import _arguments as check
from ._arguments import NUM_ACTIONS
from ._engine_batch import Batch

__all__ = ["NUM_ACTIONS", "Batch", "SensorArrays", "open_batch", "require_gymnasium"]


def open_batch(
    config: tuple[str, str],
    num_envs: int,
    overrides: Sequence[str],
    split: str,
    keys: Mapping[str, Any],
    first_env: int,
    function: str = "make_vec",
) -> Batch:
    """Open a batch.

    :param config: What _configs.config_text returns.
    :param keys: Keys of the env section that replace those of the config; None keeps the value of the config.
    :param function: Name of the function in errors.
    """
    lines = check.texts(overrides, function, "overrides")
    env_overrides = [f"{key}={value}" for key, value in keys.items() if value is not None]
    envs = check.integer(num_envs, function, "num_envs", 1, 65536)
    first = check.integer(first_env, function, "first_env", 0, 10**9)
    text, where = config
    return Batch(text, where, lines, env_overrides, check.text(split, function, "split"), envs, first)


class SensorArrays:
    """Views of the batch's memory by sensor name; each view keeps the batch alive.

    hidden: names of sensors that are not observations.
    """

    def __init__(self, batch: Batch, hidden: Collection[str] = ()) -> None:
        self.hidden_rows: dict[str, NDArray[Any]] = {name: batch.rows(name) for name in sorted(hidden)}
        self.names: list[str] = []
        self.units: dict[str, str] = {}
        self.privileged: list[str] = []
        self.rows: dict[str, NDArray[Any]] = {}
        self.final_rows: dict[str, NDArray[Any]] = {}
        boxes: dict[str, spaces.Space[Any]] = {}
        for name, dtype, shape, units, low, high, privileged in batch.sensors():
            if name in hidden:
                continue
            self.names.append(name)
            self.units[name] = units
            if privileged:
                self.privileged.append(name)
            self.rows[name] = batch.rows(name)
            self.final_rows[name] = batch.final_rows(name)
            kind: Any = np.dtype(dtype)
            if kind.kind == "f":
                box = spaces.Box(low, high, tuple(shape), kind)
            else:
                limits = np.iinfo(kind)
                box = spaces.Box(int(max(low, limits.min)), int(min(high, limits.max)), tuple(shape), kind)
            boxes[name] = box
        self.space = spaces.Dict(boxes)

    def row(self, row: int, *, copy: bool, last: bool = False) -> dict[str, NDArray[Any]]:
        """Return the observation of one row.  last: the final observation of the last episode of the row."""
        arrays = self.final_rows if last else self.rows
        return {name: array[row].copy() if copy else array[row] for name, array in arrays.items()}

    def all_of_row(self, row: int) -> dict[str, NDArray[Any]]:
        """The sensors of one row, with those that are no observations."""
        return {name: array[row] for name, array in (self.rows | self.hidden_rows).items()}


def require_gymnasium() -> None:
    if int(gymnasium.__version__.split(".")[0]) < 1:
        raise ImportError(f"gymnasium {gymnasium.__version__} is too old: pip install 'gymnasium>=1.0'")
