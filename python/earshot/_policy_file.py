# SPDX-License-Identifier: Apache-2.0
"""The file of a policy or checkpoint (trainer/checkpoint/checkpoint_format.h): a header, a MessagePack map, its XXH3."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._engine import InputError

_MAGIC = b"EARSHOT\0"
_VERSION = 2
_HEADER = struct.Struct("<8sIQ")
_MAX_DEPTH = 16
_MAX_NUMPY_DIMENSIONS = 8
_TYPES = {"float32": "<f4", "float16": "<f2", "float64": "<f8", "int64": "<i8", "int32": "<i4", "uint8": "u1", "bool": "?"}


class _Reader:
    """MessagePack values from bytes, each length checked against what is left."""

    def __init__(self, data: memoryview) -> None:
        self._data = data
        self._at = 0

    def at_end(self) -> bool:
        return self._at == len(self._data)

    def take(self, count: int) -> memoryview:
        if count > len(self._data) - self._at:
            raise ValueError("ends in the middle of a value")
        self._at += count
        return self._data[self._at - count : self._at]

    def number(self, kind: str) -> Any:
        return struct.unpack(">" + kind, self.take(struct.calcsize(kind)))[0]

    def text(self, count: int) -> str:
        return str(self.take(count), "utf-8")

    def items(self, count: int, depth: int) -> list[Any]:
        if count > len(self._data) - self._at:
            raise ValueError("has more elements than bytes")
        return [self.value(depth) for _ in range(count)]

    def map(self, count: int, depth: int) -> dict[Any, Any]:
        flat = self.items(2 * count, depth)
        if not all(isinstance(key, str) for key in flat[::2]):
            raise ValueError("has a key that is no text")
        return dict(zip(flat[::2], flat[1::2], strict=True))

    def value(self, depth: int = 0) -> Any:
        if depth > _MAX_DEPTH:
            raise ValueError("is nested too deeply")
        first = self.number("B")
        if first < 0x80:
            return first
        if first < 0x90:
            return self.map(first & 15, depth + 1)
        if first < 0xA0:
            return self.items(first & 15, depth + 1)
        if first < 0xC0:
            return self.text(first & 31)
        if first >= 0xE0:
            return first - 256
        readers: dict[int, Callable[[], Any]] = {
            0xC0: lambda: None,
            0xC2: lambda: False,
            0xC3: lambda: True,
            0xC4: lambda: self.take(self.number("B")),
            0xC5: lambda: self.take(self.number("H")),
            0xC6: lambda: self.take(self.number("I")),
            0xD9: lambda: self.text(self.number("B")),
            0xDA: lambda: self.text(self.number("H")),
            0xDB: lambda: self.text(self.number("I")),
            0xDC: lambda: self.items(self.number("H"), depth + 1),
            0xDD: lambda: self.items(self.number("I"), depth + 1),
            0xDE: lambda: self.map(self.number("H"), depth + 1),
            0xDF: lambda: self.map(self.number("I"), depth + 1),
        }
        if 0xCA <= first < 0xD4:
            return self.number("fdBHIQbhiq"[first - 0xCA])
        if first not in readers:
            raise ValueError("holds a kind of value that the format does not have")
        return readers[first]()


def _tensor(item: Any, name: str) -> NDArray[Any]:
    if not isinstance(item, dict) or not {"dtype", "shape", "data"} <= item.keys():
        raise ValueError(f"has weights '{name}' that are no tensor")
    kind, shape, data = item["dtype"], item["shape"], item["data"]
    if (
        not isinstance(kind, str)
        or kind not in _TYPES
        or not isinstance(shape, list)
        or len(shape) > _MAX_NUMPY_DIMENSIONS
        or not isinstance(data, memoryview)
    ):
        raise ValueError(f"has weights '{name}' that are no tensor")
    if not all(isinstance(extent, int) and 0 <= extent < 2**40 for extent in shape):
        raise ValueError(f"has weights '{name}' with an invalid shape")
    dtype, count = np.dtype(_TYPES[kind]), 1
    for extent in shape:
        count *= extent
    if count * dtype.itemsize != len(data):
        raise ValueError(f"has weights '{name}' whose shape does not fit their data")
    array = np.frombuffer(data, dtype).reshape(shape)
    return array.astype(np.float32) if kind in ("float16", "float32") else array


def read_policy_file(path: str | Path) -> dict[str, Any]:
    """The fields of the file; "weights": arrays by name.  Raises InputError: missing, damaged, another version."""
    from ._xxh3 import xxh3_64

    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); name a policy file or a checkpoint") from error

    def refuse(what: str) -> InputError:
        return InputError(f"{path}: {what}; copy it again, or export it again with 'earshot policy'")

    if len(data) < _HEADER.size + 8 or data[:8] != _MAGIC:
        raise refuse("is not a policy file or checkpoint")
    _, version, length = _HEADER.unpack_from(data)
    if version != _VERSION:
        raise refuse(f"has version {version} of the format, and this package reads {_VERSION}")
    if length != len(data) - _HEADER.size - 8:
        raise refuse("is cut off or has bytes behind its end")
    body = memoryview(data)[_HEADER.size : -8]
    if xxh3_64(body) != struct.unpack("<Q", data[-8:])[0]:
        raise refuse("is damaged: its hash is not that of its bytes")
    try:
        reader = _Reader(body)
        fields = reader.value()
        if not isinstance(fields, dict) or not reader.at_end():
            raise ValueError("is no map of fields")
        if not isinstance(fields.get("weights"), dict):
            raise ValueError("has no weights")
        for text in ("architecture", "config_yaml"):
            if not isinstance(fields.get(text), str):
                raise ValueError(f"has no {text}")
        fields["weights"] = {name: _tensor(item, name) for name, item in fields["weights"].items()}
    except (ValueError, struct.error) as error:
        raise refuse(str(error)) from error
    return fields
