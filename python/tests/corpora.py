# SPDX-License-Identifier: Apache-2.0
"""Corpora in the form of earshot dataset rir, made by the tests, so that they need no program; and a config for those that have one."""

from __future__ import annotations

import json
import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

PROGRAM = os.environ.get("EARSHOT_PROGRAM", "")
needs_program = pytest.mark.skipif(not PROGRAM, reason="EARSHOT_PROGRAM is not set")


def small_config(shoeboxes: int, rooms_per_folder: int) -> str:
    """Of a corpus that the program makes in a second."""
    return f"""
seed: 1
shoeboxes: {{count: {shoeboxes}, min_size_m: [3, 2.4, 3], max_size_m: [5, 3, 5], absorption: [0.3, 0.6]}}
sources_per_room: 1
listeners_per_source: 2
rooms_per_folder: {rooms_per_folder}
channels: mono
acoustics: {{preset: fast, rir_length_s: 0.1, rays: 8, early_order: 1}}
"""


def wav_bytes(samples: np.ndarray[Any, Any], rate: int) -> bytes:
    """32-bit floats in a header of its own."""
    data = np.ascontiguousarray(samples.T, dtype="<f4").tobytes()
    channels = samples.shape[0]
    form = struct.pack("<HHIIHH", 3, channels, rate, 4 * channels * rate, 4 * channels, 32)
    return (
        b"RIFF"
        + struct.pack("<I", 28 + 8 + len(data))
        + b"WAVEfmt "
        + struct.pack("<I", 16)
        + form
        + b"data"
        + struct.pack("<I", len(data))
        + data
    )


def make_corpus(
    folder: Path, responses: int = 23, *, samples: int = 160, channels: int = 2, seed: int = 1, scene: str = "shoebox:4x3x5"
) -> Path:
    """Responses of noise with labels; every fifth lacks times, every seventh has no stated error."""
    draw = np.random.default_rng(seed)
    (folder / "00000").mkdir(parents=True)
    lines = []
    for i in range(responses):
        name = f"00000/{i:06}_s00_l0000"
        rir = draw.standard_normal((channels, samples)).astype(np.float32) * np.exp(-np.arange(samples, dtype=np.float32) / 40)
        (folder / f"{name}.wav").write_bytes(wav_bytes(rir, 8000))
        times = None if i % 5 == 4 else float(np.round(draw.uniform(0.2, 0.8), 6))
        lines.append(
            {
                "id": name.split("/")[1],
                "file": f"{name}.wav",
                "scene": scene,
                "scene_hash": f"{i:016x}",
                "room": i // 4,
                "source": {"index": 0, "position_m": [1.0, 1.5, float(i)], "heading_deg": 12.5, "pattern": "omni"},
                "listener": {"index": i, "position_m": [2.0, 1.5, 0.25], "heading_deg": 0.0, "pitch_deg": 0.0, "roll_deg": 0.0},
                "distance_m": 1.5,
                "azimuth_deg": -20.5,
                "elevation_deg": 0.0,
                "line_of_sight": i % 2 == 0,
                "direct_delay_s": 0.004,
                "drr_db": None if i % 3 == 2 else float(np.round(draw.uniform(-9, 3), 6)),
                "t20_mid_s": times,
                "t20_s": [0.5, times, times],
                "rt60_s": [0.5, times, times],
                "c50_db": [1.0, 2.0, 3.0],
                "t20_error_s": [None, None, None]
                if i % 7 == 6 or times is None
                else [0.1, 0.02 * times * (1 + i % 6), 0.02 * times * (1 + i % 6)],
                "field_t20_error": None,
                "num_samples": samples,
                "gain": 1.0,
            }
        )
    (folder / "manifest.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    description = {
        "earshot_corpus": 1,
        "engine": "0123456789ab Release",
        "rooms": -(-responses // 4),
        "responses": responses,
        "channels": ["left", "right"][:channels],
        "sample_rate_hz": 8000.0,
        "bands_hz": [125.9, 501.2, 1000.0],
        "config": "seed: 1\nhrtf: ''\nchannels: binaural\n",
    }
    (folder / "corpus.json").write_text(json.dumps(description))
    return folder


def change_line(folder: Path, number: int, **keys: Any) -> None:
    lines = (folder / "manifest.jsonl").read_text().splitlines()
    lines[number] = json.dumps({**json.loads(lines[number]), **keys})
    (folder / "manifest.jsonl").write_text("\n".join(lines) + "\n")


def tree(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}
