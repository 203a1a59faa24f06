# SPDX-License-Identifier: Apache-2.0
"""The built-in network of a policy (policy/actor_critic.h) in numpy, float32."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]

NUM_ACTIONS = 4
_PICTURES = ("depth", "rgb", "normals", "topdown_map")  #: last word of their names
_SOUNDS = ("spectrogram", "interaural")
_TURNED = ("gps_compass", "pose")  #: whose third number is an angle
_BYTES = ("rgb", "topdown_map")


@dataclass(frozen=True)
class Sensor:
    """One observation of a policy: its name, and the shape of one row."""

    name: str
    shape: tuple[int, ...]

    @property
    def kind(self) -> str:
        for kind in (*_PICTURES, "semantic"):
            if self.name == kind or self.name.endswith("_" + kind):
                return kind
        return self.name

    @property
    def is_picture(self) -> bool:
        return self.kind in _PICTURES

    @property
    def is_sound(self) -> bool:
        return self.kind in _SOUNDS

    @property
    def is_bytes(self) -> bool:
        return self.kind in _BYTES

    @property
    def camera(self) -> str:
        """What the pictures of one camera have in common: the start of their names; the map is a picture by itself."""
        return "a map" if self.kind == "topdown_map" else self.name.removesuffix(self.kind)


@dataclass(frozen=True)
class Encoder:
    """Sensors whose channels are one picture, and the three convolutions that read it."""

    prefix: str  #: of the weights
    sensors: tuple[Sensor, ...]
    strides: tuple[int, int, int]


@dataclass(frozen=True)
class Architecture:
    """What the line of a policy file says of its network."""

    sensors: tuple[Sensor, ...]
    hidden_size: int
    remembers: bool
    guided_critic: bool
    normalizes_values: bool
    encoders: tuple[Encoder, ...] = field(default=())  #: sound first, as the recurrent layer reads them

    @staticmethod
    def of(line: str) -> Architecture:
        """Raises ValueError if the line is not one of a built-in network."""
        if line.startswith("module "):
            raise ValueError("has a network of its own, a TorchScript module: load that with torch ('earshot policy FILE --module net.pt')")
        match = re.fullmatch(r"actor-critic v1:((?: \w+ [0-9x]+(?: -> \d+)?,)+) conv \d+, gru (\d+), actions (\d+)(.*)", line)
        if match is None or int(match[3]) != NUM_ACTIONS:
            raise ValueError(f"has an architecture that this package does not know, '{line[:60]}'")
        sensors = tuple(
            Sensor(name, tuple(int(extent) for extent in shape.split("x"))) for name, shape in re.findall(r"(\w+) ([0-9x]+)", match[1])
        )
        endings = match[4]
        return Architecture(
            sensors,
            int(match[2]),
            remembers="without memory" not in endings,
            guided_critic="guided critic" in endings,
            normalizes_values="normalized values" in endings,
            encoders=_encoders(sensors),
        )


def _encoders(sensors: tuple[Sensor, ...]) -> tuple[Encoder, ...]:
    encoders = []
    sounds = tuple(sensor for sensor in sensors if sensor.is_sound)
    if sounds:
        small = min(sounds[0].shape[:2]) < 30
        encoders.append(Encoder("audio", sounds, (2, 2, 1) if small else (4, 2, 1)))
    cameras: dict[str, list[Sensor]] = {}
    for sensor in sensors:
        if sensor.is_picture:
            cameras.setdefault(sensor.camera, []).append(sensor)
    for index, pictures in enumerate(cameras.values()):
        encoders.append(Encoder("visual" if index == 0 else f"visual_{index}", tuple(pictures), (4, 2, 2)))
    return tuple(encoders)


def _convolution(picture: Array, weight: Array, bias: Array, stride: int) -> Array:
    """picture [N, channels, rows, columns], weight [out, channels, kernel, kernel]; no padding."""
    kernel = weight.shape[2]
    windows = np.lib.stride_tricks.sliding_window_view(picture, (kernel, kernel), (2, 3))[:, :, ::stride, ::stride]
    product = np.tensordot(windows, weight, ([1, 4, 5], [1, 2, 3]))  # [N, rows, columns, out]
    convolved: Array = np.ascontiguousarray(np.moveaxis(product + bias, 3, 1))
    return convolved


def _sigmoid(x: Array) -> Array:
    result: Array = np.float32(0.5) * (np.tanh(np.float32(0.5) * x) + np.float32(1))  # without overflow
    return result


class Network:
    """weights: by the names of the file."""

    def __init__(self, architecture: Architecture, weights: Mapping[str, Array]) -> None:
        self.architecture = architecture
        self.weights = weights

    def step(self, observations: Mapping[str, NDArray[np.generic]], state: Array) -> tuple[Array, Array, Array]:
        """observations [N, ...] by name; state [N, H], zero where an episode begins.  Returns logits [N, 4], values [N], state."""
        state = state if self.architecture.remembers else np.zeros_like(state)
        features = [self._features(sensor, observations[sensor.name]) for sensor in self._vectors()]
        features += [self._encoded(encoder, observations) for encoder in self.architecture.encoders]
        state = self._gru(np.concatenate(features, 1), state)
        return self._linear("actor", state), self._values(state), state

    def _vectors(self) -> list[Sensor]:
        return [sensor for sensor in self.architecture.sensors if not sensor.is_picture and not sensor.is_sound]

    @staticmethod
    def _features(sensor: Sensor, rows: NDArray[np.generic]) -> Array:
        if sensor.kind == "previous_action":
            return np.eye(NUM_ACTIONS + 1, dtype=np.float32)[rows[:, 0].astype(np.int64) + 1]
        values = rows.astype(np.float32)
        if sensor.kind not in _TURNED:
            return values
        angle = values[:, 2:3]
        return np.concatenate([values[:, :2], np.cos(angle), np.sin(angle), values[:, 3:]], 1)

    def _encoded(self, encoder: Encoder, observations: Mapping[str, NDArray[np.generic]]) -> Array:
        channels = []
        for sensor in encoder.sensors:
            rows = observations[sensor.name].astype(np.float32)
            channels.append(rows / np.float32(255) if sensor.is_bytes else rows)
        picture = np.moveaxis(np.concatenate(channels, 3), 3, 1)
        for layer, stride in enumerate(encoder.strides, 1):
            name = f"{encoder.prefix}.conv{layer}"
            picture = _convolution(picture, self.weights[name + ".weight"], self.weights[name + ".bias"], stride)
            if layer < len(encoder.strides):
                picture = np.maximum(picture, np.float32(0))
        return np.maximum(self._linear(encoder.prefix + ".linear", picture.reshape(len(picture), -1)), np.float32(0))

    def _gru(self, inputs: Array, state: Array) -> Array:
        from_input = inputs @ self.weights["rnn.weight_ih"].T + self.weights["rnn.bias_ih"]
        recurrent = state @ self.weights["rnn.weight_hh"].T + self.weights["rnn.bias_hh"]
        (ir, iz, inew), (hr, hz, hnew) = np.split(from_input, 3, 1), np.split(recurrent, 3, 1)
        update = _sigmoid(iz + hz)
        candidate = np.tanh(inew + _sigmoid(ir + hr) * hnew)
        after: Array = candidate + update * (state - candidate)
        return after

    def _linear(self, name: str, rows: Array) -> Array:
        product: Array = rows @ self.weights[name + ".weight"].T + self.weights[name + ".bias"]
        return product

    def _values(self, state: Array) -> Array:
        """Zero with a guided critic, which reads what only a training knows."""
        if self.architecture.guided_critic:
            return np.zeros(len(state), np.float32)
        values = self._linear("critic", state)[:, 0]
        if self.architecture.normalizes_values:
            values = values * self.weights["value_deviation"] + self.weights["value_mean"]
        return values
