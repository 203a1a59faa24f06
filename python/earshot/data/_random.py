# SPDX-License-Identifier: Apache-2.0
"""Random numbers that are a function of what they are for."""

from __future__ import annotations

import enum

import numpy as np

from .._engine import InputError


class Purpose(enum.IntEnum):
    """What numbers are drawn for: two purposes share none."""

    augmentation = 0
    room = 1
    place = 2


def stream(purpose: Purpose, seed: int, first: int, second: int) -> np.random.Generator:
    """Numbers of (purpose, seed, first, second), the last three in [0, 2^64), by Philox (Salmon et al. 2011)."""
    for name, value in (("seed", seed), ("epoch", first), ("index", second)):
        if not 0 <= value < 2**64:
            raise InputError(f"{name} is {value}; give a whole number in [0, 2^64)")
    return np.random.Generator(
        np.random.Philox(key=np.array([seed, 0x4541525348], np.uint64), counter=np.array([0, purpose, first, second], np.uint64))
    )
