# SPDX-License-Identifier: Apache-2.0
"""WAV files as bytes."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray


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
