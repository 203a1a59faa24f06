# SPDX-License-Identifier: Apache-2.0
"""Resident memory over many resets and scenes.

python flat_memory.py [RESETS] [SCENES]: prints the memory after the first tenth and at the end, and how far it has grown.
"""

from __future__ import annotations

import ctypes
import gc
import sys
from collections.abc import Callable

import numpy as np
from conftest import SMALL

import earshot

#: Cheap: a box, little sound, no light.
CHEAP = {
    **SMALL,
    "threads": 1,
    "observation": {"camera": {"width_px": 8, "height_px": 8}, "pointgoal": True},
    "acoustics": {"preset": "fast", "rir_length_s": 0.05, "rays": 32, "field": "off"},
}


def resident_kb() -> int:
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)  # free memory that the allocator keeps is none that is held
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmRSS"))


def growth(work: Callable[[int], None], count: int) -> tuple[int, int]:
    """Resident kB after the first tenth and after all."""
    first = max(1, count // 10)
    for index in range(first):
        work(index)
    before = resident_kb()
    for index in range(first, count):
        work(index)
    return before, resident_kb()


def resets(count: int) -> tuple[int, int]:
    envs = earshot.make_vec(CHEAP, num_envs=2)
    actions = np.array([1, 2])

    def reset(index: int) -> None:
        envs.reset(seed=index)
        envs.step(actions)

    return growth(reset, count)


def scenes(count: int) -> tuple[int, int]:
    def render(index: int) -> None:
        scene = earshot.Scene(f"shoebox:{3 + index % 7}x3x{3 + index % 5}", preset="fast", settings={"rir_length_s": 0.05, "rays": 32})
        assert scene.source([1, 1.5, 1]).render([2, 1.2, 2]).any()

    return growth(render, count)


if __name__ == "__main__":
    counts = [int(text) for text in sys.argv[1:]] or [10_000, 2_000]
    for name, function, number in zip(("resets", "scenes"), (resets, scenes), counts, strict=False):
        first_kb, last_kb = function(number)
        print(f"{number} {name}: {first_kb} kB, then {last_kb} kB, {100 * (last_kb / first_kb - 1):+.2f} %", flush=True)
