# SPDX-License-Identifier: Apache-2.0
"""WAV files as bytes."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._engine import InputError


def wav(samples: NDArray[Any], rate_hz: float) -> bytes:
    """samples: [channels, samples] of int16 or float32, which the file holds as they are."""
    is_float = samples.dtype.kind == "f"
    data = np.ascontiguousarray(samples.T, dtype="<f4" if is_float else "<i2").tobytes()
    (channels, length), rate, size = samples.shape, round(rate_hz), 4 if is_float else 2
    chunks = [(b"fmt ", struct.pack("<HHIIHH", 3 if is_float else 1, channels, rate, rate * channels * size, channels * size, 8 * size))]
    if is_float:  # the standard asks for the size of an extension, and for the number of samples
        chunks = [(b"fmt ", chunks[0][1] + struct.pack("<H", 0)), (b"fact", struct.pack("<I", length))]
    body = b"".join(name + struct.pack("<I", len(part)) + part for name, part in [*chunks, (b"data", data)])
    return b"RIFF" + struct.pack("<I", 4 + len(body)) + b"WAVE" + body


def samples_of(data: bytes, where: str) -> tuple[NDArray[np.float32], int]:
    """The samples of a WAV file, float32 [channels, samples] with full scale 1, and its rate in Hz.

    :raises InputError: It is no WAV file of 16-bit integers, 24-bit integers or 32-bit floats.
    """
    if data[:4] != b"RIFF" or data[8:12] != b"WAVE":
        raise InputError(f"{where}: is no WAV file")
    at, form = 12, (0, 0, 0, 0)  # kind, channels, rate, bits
    while at + 8 <= len(data):
        name, size = data[at : at + 4], int.from_bytes(data[at + 4 : at + 8], "little")
        body = data[at + 8 : at + 8 + size]
        if name == b"fmt ":
            kind, channels, rate, _, _, bits = struct.unpack("<HHIIHH", body[:16])
            form = (struct.unpack("<H", body[24:26])[0] if kind == 0xFFFE else kind, channels, rate, bits)
        elif name == b"data" and form[1] > 0:
            return _decode(body, form[0], form[3], where).reshape(-1, form[1]).T.copy(), form[2]
        at += 8 + size + size % 2
    raise InputError(f"{where}: has no samples; it was cut")


def _decode(body: bytes, kind: int, bits: int, where: str) -> NDArray[np.float32]:
    if (kind, bits) == (3, 32):
        return np.frombuffer(body, "<f4").astype(np.float32)
    if (kind, bits) == (1, 16):
        return np.frombuffer(body, "<i2").astype(np.float32) / np.float32(2**15)
    if (kind, bits) == (1, 24):
        wide = np.zeros((len(body) // 3, 4), np.uint8)
        wide[:, 1:] = np.frombuffer(body, np.uint8).reshape(-1, 3)
        return wide.view("<i4").ravel().astype(np.float32) / np.float32(2**31)
    raise InputError(f"{where}: has samples of kind {kind} with {bits} bits; write 16-bit or 24-bit integers or 32-bit floats")
