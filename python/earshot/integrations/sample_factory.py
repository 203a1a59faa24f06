# SPDX-License-Identifier: Apache-2.0
"""A batch as an environment of Sample Factory, which pins gymnasium below 1.0::

    from earshot.integrations.sample_factory import register

    register("quick", "earshot:train/quick", num_envs=16)     # then --env=quick --batched_sampling=True

An env of Sample Factory with many agents is a batch here: agent i is env i.
"""

from __future__ import annotations

import functools
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from .._configs import Config
from ._common import Observation, require
from ._plain import PlainBatch

require("sample_factory", "sample-factory")

from sample_factory.envs.env_utils import register_env  # noqa: E402

SMALLEST_PICTURE = 36  #: sides that the convolutions of Sample Factory take
Step = tuple[Observation, Any, Any, Any, list[dict[str, Any]]]


class EarshotSampleFactoryEnv(gymnasium.Env[Any, Any]):
    """Arguments are those of earshot.make_vec; episodes begin again in the same step.

    Observations: the sensors as [num_envs, channels, height, width] where both sides have SMALLEST_PICTURE pixels, else as rows of
    numbers; what is neither float32 nor a picture of bytes becomes float32.  The info of the last step of an episode has its metrics as
    episode_extra_stats.
    """

    is_multiagent = True
    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(self, config: Config, num_envs: int = 1, **arguments: Any) -> None:
        self.plain = PlainBatch(config, num_envs, **arguments)
        self.num_agents = num_envs
        self.render_mode = None
        self.action_space = self.plain.action_space
        boxes: dict[str, spaces.Space[Any]] = {}
        for name, box in self.plain.sensors.space.spaces.items():
            assert isinstance(box, spaces.Box)
            shape = _shape_of(box.shape)
            picture = box.dtype == np.uint8 and len(shape) == 3
            boxes[name] = spaces.Box(0, 255, shape, np.uint8) if picture else spaces.Box(-np.inf, np.inf, shape, np.float32)
        self._dtypes: dict[str, Any] = {name: box.dtype for name, box in boxes.items()}
        self.observation_space = spaces.Dict(boxes)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, list[dict[str, Any]]]:  # type: ignore[override]
        del options
        self.plain.reset(seed)
        return self._observations(), [{} for _ in range(self.num_agents)]

    def step(self, action: Any) -> Step:  # type: ignore[override]
        ends = self.plain.step(action)
        infos: list[dict[str, Any]] = [{"episode_extra_stats": end} if end else {} for end in ends]
        plain = self.plain
        return self._observations(), plain.rewards.copy(), plain.terminated.copy(), plain.truncated.copy(), infos

    def render(self) -> None:
        return None

    def close(self) -> None:
        self.plain.close()

    def _observations(self) -> Observation:
        rows: Observation = {}
        for name, array in self.plain.sensors.rows.items():
            moved = np.moveaxis(array, -1, 1) if array.ndim == 4 else array
            moved = moved.reshape(len(array), *_shape_of(array.shape[1:]))
            rows[name] = np.array(moved, dtype=self._dtypes[name], order="C")
        return rows


def _shape_of(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Of a sensor [height, width, channels]: channels first, or one row where a side is too small for convolutions."""
    if len(shape) == 3 and min(shape[:2]) >= SMALLEST_PICTURE:
        return shape[2], shape[0], shape[1]
    return (int(np.prod(shape)),)


def register(name: str, config: Config, num_envs: int = 16, **arguments: Any) -> str:
    """Registers a config for --env=NAME.  Each env of Sample Factory gets episodes of its own."""
    register_env(name, functools.partial(_create, config, num_envs, arguments))
    return name


def _create(
    config: Config,
    num_envs: int,
    arguments: dict[str, Any],
    full_name: str,
    cfg: Any = None,
    env_config: Any = None,
    render_mode: str | None = None,
) -> EarshotSampleFactoryEnv:
    """A function of the module, as Sample Factory sends it to other processes."""
    del full_name, cfg, render_mode
    number = getattr(env_config, "env_id", 0) if env_config is not None else 0
    return EarshotSampleFactoryEnv(config, num_envs, **{"first_env": number * num_envs, **arguments})
