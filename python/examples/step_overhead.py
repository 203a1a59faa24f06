# SPDX-License-Identifier: Apache-2.0
"""What Python adds to a step of 32 envs: processor time of the calling thread in envs.step beside that in the engine.

python step_overhead.py [STEPS]
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np

import earshot

HOUSE: dict[str, Any] = {
    "threads": 1,
    "task": {"max_steps": 200},
    "observation": {
        "camera": {"width_px": 64, "height_px": 64},
        "spectrogram": False,
        "interaural": True,
        "collision": True,
        "previous_action": True,
    },
    "acoustics": {"preset": "fast", "rir_length_s": 0.4, "field": "off"},
    "episodes": {
        "scenes": ["house:1000,rooms=3,area_m2=36"],
        "sounds": ["synth:telephone"],
        "episodes_per_scene": 20,
        "goals_per_scene": 3,
        "filter": {"min_geodesic_m": 1.5, "max_geodesic_m": 12, "min_ratio": 1.0},
    },
}


def main() -> None:
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    envs = earshot.make_vec(HOUSE, num_envs=32)
    envs.reset(seed=1)
    actions = np.random.default_rng(0).integers(1, 4, size=(steps, 2, 32), dtype=np.int32)  # anything but stop
    times = np.zeros((steps, 2))
    for step in range(steps):
        begin = time.thread_time()
        envs.step(actions[step, 0])
        middle = time.thread_time()
        envs.batch.step(actions[step, 1])
        times[step] = middle - begin, time.thread_time() - middle
    whole, engine = np.median(times, axis=0) * 1e3
    print(f"envs.step {whole:.2f} ms, engine {engine:.2f} ms, Python adds {100 * (whole / engine - 1):.1f} %")


if __name__ == "__main__":
    main()
