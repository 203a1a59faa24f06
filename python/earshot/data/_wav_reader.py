# SPDX-License-Identifier: Apache-2.0
"""The WAV files that the program writes."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from .._engine import InputError

_FLOAT, _EXTENSIBLE = 3, 0xFFFE


def read_wav(data: bytes, name: str = "the WAV file") -> tuple[NDArray[np.float32], int]:
    """Return samples [channels, samples] and rate of a WAV file of 32-bit floats, without conversion.

    :param name: What an error calls the file.
    :raises InputError: The bytes are no such file.
    """
    if data[:4] != b"RIFF" or data[8:12] != b"WAVE":
        raise InputError(f"{name}: is no WAV file")
    at, form, body = 12, None, None
    while at + 8 <= len(data):
        chunk, size = data[at : at + 4], int.from_bytes(data[at + 4 : at + 8], "little")
        if at + 8 + size > len(data):
            break
        if chunk == b"fmt " and size >= 16:
            form = data[at + 8 : at + 8 + size]
        elif chunk == b"data":
            body = data[at + 8 : at + 8 + size]
        at += 8 + size + size % 2
    if form is None or body is None:
        raise InputError(f"{name}: is damaged: its chunks do not end within the file")
    kind, channels, rate, _, frame, bits = struct.unpack("<HHIIHH", form[:16])
    if kind == _EXTENSIBLE and len(form) >= 26:
        kind = int.from_bytes(form[24:26], "little")
    if kind != _FLOAT or bits != 32 or channels < 1 or frame != 4 * channels or len(body) % frame:
        raise InputError(f"{name}: holds no 32-bit floats; write the corpus with format: wav")
    return np.ascontiguousarray(np.frombuffer(body, "<f4").reshape(-1, channels).T), int(rate)
