# SPDX-License-Identifier: Apache-2.0
"""Hear a generated house: three lines from a scene to a binaural room impulse response."""

import earshot

scene = earshot.Scene("house:7")  # or "my_house.glb"
source, listener = scene.random_positions(2, seed=1)
rir = scene.source(source).render(listener, channels="binaural")  # float32 [2, samples]

print(f"{rir.shape[0]} channels, {rir.shape[1]} samples at {scene.sample_rate_hz:.0f} Hz")
