# SPDX-License-Identifier: Apache-2.0
"""A small house with small pictures: seconds for the whole suite."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import pytest

Config = dict[str, Any]

SMALL: Config = {
    "seed": 3,
    "threads": 2,
    "task": {"max_steps": 12},
    "observation": {
        "camera": {"width_px": 16, "height_px": 16},
        "rgb": True,
        "pointgoal": True,
        "collision": True,
        "previous_action": True,
    },
    "acoustics": {"preset": "fast", "rir_length_s": 0.2, "field": "off"},
    "episodes": {
        "scenes": ["house:1,rooms=3,area_m2=36"],
        "sounds": ["synth:telephone", "synth:bird"],
        "episodes_per_scene": 6,
        "goals_per_scene": 2,
        "seed": 1,
        "filter": {"min_geodesic_m": 1.5, "max_geodesic_m": 12, "min_ratio": 1.0},
    },
}


@pytest.fixture
def small() -> Callable[..., Config]:
    """The config with further keys of its top level."""

    def make(**keys: Any) -> Config:
        config = copy.deepcopy(SMALL)
        config.update(keys)
        return config

    return make
