# SPDX-License-Identifier: Apache-2.0
"""The sensor with the methods of the original's: against responses of the package, and closed forms of directions."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from habitat_sets import l_shaped_room

import earshot
from earshot.integrations.habitat import AudioSensor
from earshot.integrations.habitat.audio_sensor import angles_deg

ROOM = "shoebox:8x3x6@0.3"
FAST: dict[str, Any] = {"settings": {"rir_length_s": 0.2}, "seed": 4}
SOURCE, LISTENER = [2.0, 1.5, 5.0], [5.0, 1.5, 2.0]


def simulated(sensor: AudioSensor, rotation: Any = (1, 0, 0, 0)) -> np.ndarray[Any, Any]:
    sensor.setAudioSourceTransform(SOURCE)
    sensor.setAudioListenerTransform(LISTENER, rotation)
    sensor.runSimulation(None)
    return sensor.getIR()


def turn(axis: int, angle: float) -> np.ndarray[Any, Any]:
    q = np.zeros(4)
    q[0], q[1 + axis] = math.cos(angle / 2), math.sin(angle / 2)
    return q


def product(p: Any, q: Any) -> np.ndarray[Any, Any]:
    """Of quaternions [w, x, y, z]."""
    a, b = np.asarray(p), np.asarray(q)
    return np.array([a[0] * b[0] - a[1:] @ b[1:], *(a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:]))])


def test_responses_are_those_of_the_package() -> None:
    rir = simulated(AudioSensor(ROOM, **FAST), turn(1, math.radians(40)))
    source = earshot.Scene(ROOM, preset="fast", **FAST).source(SOURCE)
    assert np.array_equal(rir, source.render(LISTENER, np.degrees(2 * math.asin(math.sin(math.radians(20))))))
    assert rir.shape == (2, 3200)
    assert np.array_equal(simulated(AudioSensor(ROOM, **FAST)), simulated(AudioSensor(ROOM, **FAST)))  # a seed repeats it


def test_angles_are_those_that_a_quaternion_was_made_of() -> None:
    rng = np.random.default_rng(9)
    for _ in range(200):
        heading, pitch, roll = rng.uniform(-math.pi, math.pi), rng.uniform(-1.5, 1.5), rng.uniform(-math.pi, math.pi)
        q = product(product(turn(1, heading), turn(0, pitch)), turn(2, -roll)) * rng.uniform(0.5, 2) * rng.choice([-1, 1])
        assert angles_deg(q) == pytest.approx(np.degrees([heading, pitch, roll]), abs=1e-6)
    for pitch in (math.pi / 2, -math.pi / 2):  # heading and roll cannot be told apart: the turn as a whole is kept
        found = angles_deg(product(turn(1, 0.7), turn(0, pitch)))
        assert found == pytest.approx((math.degrees(0.7), math.degrees(pitch), 0), abs=1e-3)


def test_the_source_is_louder_at_the_ear_that_faces_it() -> None:
    sensor = AudioSensor("shoebox:20x10x20@1", **FAST)
    for heading, louder in ((0.0, 1), (180.0, 0)):  # the source is at +x: right of an agent that looks along -z
        sensor.setAudioSourceTransform([12.0, 5.0, 10.0])
        sensor.setAudioListenerTransform([10.0, 5.0, 10.0], turn(1, math.radians(heading)))
        sensor.runSimulation(None)
        energy = np.square(sensor.getIR()).sum(axis=1)
        assert energy[louder] > 2 * energy[1 - louder]


def test_a_wall_hides_the_source_and_only_then(tmp_path: Path) -> None:
    sensor = AudioSensor(l_shaped_room(tmp_path / "room.obj"), channels="mono", **FAST)
    for source, listener, visible in (
        ([1.5, 1.5, 6.0], [1.5, 1.5, 1.5], True),
        ([1.5, 1.5, 6.5], [5.5, 1.5, 2.5], False),  # around the corner
        ([5.5, 1.5, 2.5], [1.5, 1.5, 6.5], False),
        ([5.0, 1.5, 1.5], [1.0, 1.5, 1.5], True),
    ):
        sensor.setAudioSourceTransform(source)
        sensor.setAudioListenerTransform(listener, [1, 0, 0, 0])
        sensor.runSimulation(None)
        assert sensor.sourceIsVisible() is visible
        assert 0.9 < sensor.getRayEfficiency() <= 1.0  # a closed room


def test_materials_stay_through_reset_and_change_the_sound(tmp_path: Path) -> None:
    materials = tmp_path / "soft.json"
    materials.write_text('{"materials": [{"name": "soft", "labels": ["default"], "absorption": [125, 0.95], "scattering": [125, 0.5]}]}')
    sensor = AudioSensor(l_shaped_room(tmp_path / "room.obj"), **FAST)
    hard = simulated(sensor)
    sensor.setAudioMaterialsJSON(materials)
    soft = simulated(sensor)
    assert np.square(soft).sum() < 0.7 * np.square(hard).sum()
    sensor.reset()
    assert np.array_equal(simulated(sensor), soft)
    turned = AudioSensor(f"{l_shaped_room(tmp_path / 'turned.obj', up='z')},up=z", **FAST)
    turned.setAudioMaterialsJSON(materials)
    assert np.square(simulated(turned)).sum() == pytest.approx(np.square(soft).sum(), rel=0.1)


def test_the_file_has_the_samples_of_the_response(tmp_path: Path) -> None:
    sensor = AudioSensor(ROOM, **FAST)
    rir = simulated(sensor)
    sensor.writeIRWave(tmp_path / "rir.wav")
    data = (tmp_path / "rir.wav").read_bytes()
    assert data[:4] == b"RIFF"
    assert struct.unpack("<I", data[4:8])[0] == len(data) - 8
    assert struct.unpack("<HHI", data[20:28]) == (3, 2, 16000)
    begin = data.index(b"data") + 8
    assert np.array_equal(np.frombuffer(data[begin:], "<f4").reshape(-1, 2).T, rir)


def test_calls_out_of_order_and_wrong_values_are_refused_with_one_line(tmp_path: Path) -> None:
    sensor = AudioSensor(ROOM, **FAST)
    with pytest.raises(earshot.RunError, match="there is no response; call runSimulation first"):
        sensor.getIR()
    with pytest.raises(earshot.RunError, match="there is no source; call setAudioSourceTransform first"):
        sensor.runSimulation(None)
    sensor.setAudioSourceTransform(SOURCE)
    with pytest.raises(earshot.RunError, match="there is no listener; call setAudioListenerTransform first"):
        sensor.runSimulation(None)
    with pytest.raises(earshot.InputError, match="give three finite numbers"):
        sensor.setAudioSourceTransform([1, 2])
    with pytest.raises(earshot.InputError, match="that is not zero"):
        sensor.setAudioListenerTransform(LISTENER, [0, 0, 0, 0])
    with pytest.raises(earshot.InputError, match="is no file"):
        sensor.setAudioMaterialsJSON(tmp_path / "none.json")
    lost = AudioSensor()
    lost.setAudioSourceTransform(SOURCE)
    lost.setAudioListenerTransform(LISTENER, [1, 0, 0, 0])
    with pytest.raises(earshot.RunError, match="there is no scene"):
        lost.runSimulation(None)
