# SPDX-License-Identifier: Apache-2.0
"""Speech through responses, with noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._engine import InputError
from ..integrations._common import require
from ._random import Purpose, stream
from ._responses import Responses

Samples = NDArray[np.float32]
Range = tuple[float, float]


@dataclass(frozen=True)
class Augmented:
    """An augmented utterance."""

    signal: Samples  #: [channels, samples]
    labels: dict[str, Any]  #: of the response, with ``snr_db`` and ``gain``


class Augment:
    """Sends speech through a response drawn at random and adds noise (extra ``data``, SciPy).

    A result is a function of (responses, arguments, speech, epoch, index).  The process, the number of workers, how they were started and
    the order of calls play no part.  A pickle holds what the responses hold.

    :param noise: None, "white" (independent between channels), or sounds [samples] of the rate of the responses, which loop from an offset
        drawn for each channel.
    :param snr_db: Range of the ratio of speech to noise, over all channels and the whole signal.
    :param level_dbfs: Range of the root mean square of the signal; None keeps the level of the response.
    :param cut: End with the last sample of the speech instead of the last echo.

    >>> from earshot.data import ArrayResponses
    >>> echo = Augment(ArrayResponses([[1, 0, 0.5]], rate_hz=8000))
    >>> np.round(echo([1, 1], index=3).signal, 6).tolist()
    [[1.0, 1.0, 0.5, 0.5]]
    """

    def __init__(
        self,
        responses: Responses,
        *,
        noise: str | Sequence[ArrayLike] | None = None,
        snr_db: Range = (5, 25),
        level_dbfs: Range | None = None,
        cut: bool = False,
        seed: int = 0,
    ) -> None:
        self.responses = responses
        self.rate_hz = responses.rate_hz
        self.seed = seed
        self._cut = cut
        self._snr_db = _range(snr_db, "snr_db", -60, 120)
        self._level_dbfs = None if level_dbfs is None else _range(level_dbfs, "level_dbfs", -100, 0)
        if isinstance(noise, str) and noise != "white":
            raise InputError(f"Augment: noise is {noise!r}; give None, 'white' or sounds")
        self._white = isinstance(noise, str)
        self._noise = [] if noise is None or isinstance(noise, str) else [_sound(sound, f"noise {i}") for i, sound in enumerate(noise)]
        if noise is not None and not self._white and not self._noise:
            raise InputError("Augment: noise is an empty list; give None, 'white' or sounds")
        stream(Purpose.augmentation, seed, 0, 0)

    def __call__(self, speech: ArrayLike, *, index: int, epoch: int = 0) -> Augmented:
        """Augment dry speech [samples] of the rate of the responses.

        :param index: Number of the utterance; with ``epoch`` it decides what is drawn.
        :raises InputError: Speech that is empty, silent or not finite.
        """
        dry = _sound(speech, f"speech {index}")
        draw = stream(Purpose.augmentation, self.seed, epoch, index)
        number = int(draw.integers(len(self.responses)))
        signal = _convolve(dry, self.responses[number])
        if self._cut:
            signal = signal[:, : len(dry)]
        labels = dict(self.responses.labels(number))
        power = _power(signal)
        labels["snr_db"] = None
        if self._white or self._noise:
            snr_db = _drawn(draw, self._snr_db)
            noise = self._draw_noise(draw, signal.shape)
            of_noise = _power(noise)
            if of_noise > 0 and power > 0:
                signal += noise * np.float32(np.sqrt(power / of_noise) * 10 ** (-snr_db / 20))
                labels["snr_db"] = snr_db
        gain = 1.0
        if self._level_dbfs is not None:
            level = _drawn(draw, self._level_dbfs)
            power = _power(signal)
            gain = 10 ** (level / 20) / np.sqrt(power) if power > 0 else 1.0
            signal *= np.float32(gain)
        labels["gain"] = float(gain)
        return Augmented(signal, labels)

    def _draw_noise(self, draw: np.random.Generator, shape: tuple[int, ...]) -> Samples:
        if self._white:
            return draw.standard_normal(shape, dtype=np.float32)
        sound = self._noise[int(draw.integers(len(self._noise)))]
        offsets = draw.integers(len(sound), size=shape[0])
        return np.stack([np.resize(np.roll(sound, -offset), shape[1]) for offset in offsets])


def _convolve(dry: Samples, response: Samples) -> Samples:
    """[channels, samples of both - 1]: one transform of the whole length.  Rounding: 1e-6 of the peak."""
    length = len(dry) + response.shape[1] - 1
    # That of NumPy takes four times as long for 32-bit floats.
    fft = require("scipy.fft", "data")
    size = fft.next_fast_len(length, real=True)
    spectrum = fft.rfft(response, size)
    spectrum *= fft.rfft(dry, size)
    wet = fft.irfft(spectrum, size, overwrite_x=True)
    return np.ascontiguousarray(wet[:, :length], dtype=np.float32)


def _power(samples: Samples) -> float:
    """Mean square."""
    flat = samples.reshape(-1)
    return float(np.dot(flat, flat)) / flat.size


def _drawn(draw: np.random.Generator, interval: Range) -> float:
    return interval[0] + draw.random() * (interval[1] - interval[0])


def _range(interval: Range, name: str, low: float, high: float) -> Range:
    if len(interval) != 2 or not low <= interval[0] <= interval[1] <= high:
        raise InputError(f"Augment: {name} is {interval}; give LOW, HIGH in [{low}, {high}]")
    return float(interval[0]), float(interval[1])


def _sound(samples: ArrayLike, name: str) -> Samples:
    array = np.asarray(samples, dtype=np.float32)
    if array.ndim != 1 or not array.size:
        raise InputError(f"{name}: has the shape {array.shape}; give samples of one channel")
    power = float(np.dot(array, array))
    if not np.isfinite(power) or power == 0:
        raise InputError(f"{name}: is silent or has values that are not finite; leave it out")
    return array
