# SPDX-License-Identifier: Apache-2.0
"""Pickles and files: what travels by recipe has the bytes that it was made from, or is refused with one line."""

from __future__ import annotations

import copy
import json
import os
import pickle
import wave
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import earshot

Make = Callable[..., dict[str, Any]]
SETTINGS = {"rir_length_s": 0.1, "rays": 256}
SOURCE, LISTENER = [2, 1.5, 2], [4, 1.5, 3]


def room() -> earshot.Scene:
    return earshot.Scene("shoebox:6x3x5", preset="fast", settings=SETTINGS)


def write_balloon(path: Path, back_db: float) -> None:
    gains = [[[0, back_db / 2, back_db, back_db / 2]]]
    path.write_text(
        json.dumps({"frequencies_hz": [1000], "azimuths_deg": [0, 90, 180, 270], "elevations_deg": [0], "gains_db": gains}),
    )


def write_array(path: Path, offset_m: float, pattern: str = "omni") -> None:
    microphones = [{"position_m": [0, 0, 0]}, {"position_m": [offset_m, 0, 0], "pattern": pattern}]
    path.write_text(json.dumps({"microphones": microphones}))


def write_sound(path: Path, frequency_hz: float) -> None:
    samples = np.sin(2 * np.pi * frequency_hz * np.arange(16000) / 16000) * 20000
    with wave.open(str(path), "wb") as file:
        file.setparams((1, 2, 16000, 0, "NONE", ""))
        file.writeframes(samples.astype(np.int16).tobytes())


def write_room(path: Path, height_m: float) -> None:
    corners = [(x, y, z) for x in (0, 6) for y in (0, height_m) for z in (0, 5)]
    faces = [(1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6)]
    path.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "".join(f"f {a} {b} {c} {d}\n" for a, b, c, d in faces))


def expect_refused(text: bytes, name: str, since: str) -> None:
    with pytest.raises(earshot.InputError, match=rf"{name}: has changed since the {since}; make it again") as caught:
        pickle.loads(text)
    assert "\n" not in str(caught.value)


def keep_times(path: Path, write: Callable[[], None]) -> None:
    """Other bytes with the size and the times of the old ones: nothing but the bytes tells."""
    before = path.stat()
    write()
    assert path.stat().st_size == before.st_size
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def test_a_balloon_is_found_from_another_folder_and_refused_once_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "other").mkdir()
    balloon = tmp_path / "balloon.json"
    write_balloon(balloon, -12)
    monkeypatch.chdir(tmp_path)
    source = room().source(SOURCE, pattern="balloon.json", heading_deg=90)
    text, rir = pickle.dumps(source), source.render(LISTENER)
    whole_call = pickle.dumps(source.responses([LISTENER]))
    monkeypatch.chdir(tmp_path / "other")
    again = pickle.loads(text)
    assert np.array_equal(again.render(LISTENER), rir)
    twice = pickle.dumps(again)
    keep_times(balloon, lambda: write_balloon(balloon, -18))
    for pickled in (text, whole_call, twice):
        expect_refused(pickled, "balloon.json", "source was pickled")
    # What is alive keeps what it has read.
    assert np.array_equal(source.render(LISTENER), rir)
    assert np.array_equal(copy.deepcopy(source).render(LISTENER), rir)


@pytest.mark.parametrize("changed", ["array", "pattern", "mono"])
def test_channels_of_files_are_refused_once_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changed: str) -> None:
    (tmp_path / "other").mkdir()
    balloon, array = tmp_path / "balloon.json", tmp_path / "array.json"
    write_balloon(balloon, -12)
    write_array(array, 0.1, "balloon.json")
    monkeypatch.chdir(tmp_path)
    channels = "mono:balloon.json" if changed == "mono" else "array:array.json"
    response = room().source(SOURCE).response(LISTENER, channels=channels)
    text, rir = pickle.dumps(response), response.render(40)
    monkeypatch.chdir(tmp_path / "other")
    assert np.array_equal(pickle.loads(text).render(40), rir)
    late = pickle.loads(text)  # computes when it is asked
    if changed == "array":
        keep_times(array, lambda: write_array(array, 0.3, "balloon.json"))
    else:
        keep_times(balloon, lambda: write_balloon(balloon, -18))
    name = "array.json" if changed == "array" else "balloon.json"
    expect_refused(text, name, "response was pickled")
    with pytest.raises(earshot.InputError, match=rf"{name}: has changed since the response was asked for"):
        _ = late.metrics


def test_rendering_takes_the_files_as_they_are(tmp_path: Path) -> None:
    array = tmp_path / "array.json"
    source = room().source(SOURCE)
    rirs = []
    for offset_m in (0.1, 0.3, 0.1):
        write_array(array, offset_m)
        rirs.append(source.render(LISTENER, channels=f"array:{array}"))
        assert np.array_equal(rirs[-1], room().source(SOURCE).render(LISTENER, channels=f"array:{array}"))
    assert not np.array_equal(rirs[0], rirs[1])
    assert np.array_equal(rirs[0], rirs[2])


def batch_config(small: Make, folder: Path) -> dict[str, Any]:
    write_room(folder / "room.obj", 3.0)
    write_sound(folder / "ring.wav", 440)
    config = small(scene_root=str(folder), sound_root=str(folder))
    config["episodes"] = {**config["episodes"], "scenes": [str(folder / "room.obj")], "sounds": ["ring"]}
    return config


@pytest.mark.parametrize("kind", ["vector", "single"])
@pytest.mark.parametrize("changed", ["room.obj", "ring.wav"])
def test_environments_are_refused_once_their_files_have_changed(small: Make, tmp_path: Path, kind: str, changed: str) -> None:
    config = batch_config(small, tmp_path)
    envs = earshot.make_vec(config, num_envs=2) if kind == "vector" else earshot.make(config)
    envs.reset(seed=1)
    text = pickle.dumps(envs)
    again = pickle.loads(text)
    action = np.array([1, 1]) if kind == "vector" else 1
    before, after = envs.step(action)[0], again.step(action)[0]  # type: ignore[arg-type]
    for name in before:
        assert np.array_equal(before[name], after[name]), name
    path = tmp_path / changed
    keep_times(path, lambda: write_room(path, 3.5) if changed == "room.obj" else write_sound(path, 880))
    expect_refused(text, "room.obj" if changed == "room.obj" else "ring", "environments were pickled")
    # The episodes of these go on with the old bytes, which no pickle can name any more.
    for travel in (pickle.dumps, copy.deepcopy):
        with pytest.raises(earshot.InputError, match=rf"{changed}: has changed since the environments were made"):
            travel(envs)
