# SPDX-License-Identifier: Apache-2.0
"""Where augmentation takes its responses from: a corpus, arrays, or rooms simulated as they are asked for."""

from __future__ import annotations

import os
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._engine import InputError
from ._corpus import Corpus
from ._random import Purpose, stream

_KEPT_BYTES = 1 << 28


class Responses:
    """A list of responses of one rate.  Reading the same number again gives the same bits, in any process."""

    rate_hz: float

    def __len__(self) -> int:
        raise NotImplementedError

    def __getitem__(self, index: int) -> NDArray[np.float32]:
        """Samples [channels, samples]."""
        raise NotImplementedError

    def labels(self, index: int) -> dict[str, Any]:
        """What is known about the response."""
        return {"response": index}


class ArrayResponses(Responses):
    """Responses in memory.

    :param arrays: One array [channels, samples] per response, or [samples] for one channel; all with the same number of channels.
    """

    def __init__(self, arrays: Sequence[ArrayLike], *, rate_hz: float) -> None:
        self.rate_hz = float(rate_hz)
        self._arrays = [np.atleast_2d(np.array(array, dtype=np.float32)) for array in arrays]
        if not self._arrays:
            raise InputError("ArrayResponses: arrays is empty; give at least one response")
        channels = self._arrays[0].shape[0]
        for i, array in enumerate(self._arrays):
            if array.ndim != 2 or array.shape[0] != channels or array.shape[1] == 0 or not np.isfinite(array).all():
                raise InputError(
                    f"ArrayResponses: response {i} has the shape {array.shape} or values that are not finite; give [channels, samples]"
                )

    def __len__(self) -> int:
        return len(self._arrays)

    def __getitem__(self, index: int) -> NDArray[np.float32]:
        return self._arrays[index]


class CorpusResponses(Responses):
    """Responses of a corpus of ``earshot dataset rir``, read as they are asked for.  A pickle holds the path alone.

    :param rt60_s: Range of ``t20_mid_s``; responses outside of it are left out.
    :param drr_db: Range of ``drr_db``.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        *,
        rt60_s: tuple[float, float] | None = None,
        drr_db: tuple[float, float] | None = None,
    ) -> None:
        self._recipe = (os.path.abspath(folder), rt60_s, drr_db)
        self.corpus = Corpus(folder)
        self.rate_hz = self.corpus.rate_hz
        ranges = {"t20_mid_s": rt60_s, "drr_db": drr_db}
        self._rows = [i for i, line in enumerate(self.corpus.lines) if all(_within(line.get(key), given) for key, given in ranges.items())]
        if not self._rows:
            raise InputError(f"{folder}: has no response with rt60_s {rt60_s} and drr_db {drr_db}; widen the ranges")
        self._kept = _Kept()

    def __reduce__(self) -> tuple[Any, ...]:
        return _corpus_responses, (*self._recipe, self.corpus.hash)

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, index: int) -> NDArray[np.float32]:
        row = self._rows[index]
        return self._kept.get(row, self.corpus.response)

    def labels(self, index: int) -> dict[str, Any]:
        line = self.corpus.lines[self._rows[index]]
        return {
            "response": line["id"],
            **{key: line.get(key) for key in ("t20_mid_s", "drr_db", "distance_m", "azimuth_deg", "direct_delay_s")},
        }


def _corpus_responses(folder: str, rt60_s: tuple[float, float] | None, drr_db: tuple[float, float] | None, known: str) -> CorpusResponses:
    responses = CorpusResponses(folder, rt60_s=rt60_s, drr_db=drr_db)
    if responses.corpus.hash != known:
        raise InputError(f"{folder}: has changed since it was opened; open it again")
    return responses


class SimulatedResponses(Responses):
    """Responses of random shoebox rooms, simulated when they are first asked for.  A pickle holds the settings alone.

    Response ``i`` belongs to room ``i // per_room``; source and listener stand anywhere at least 0.5 m from walls and from each other.

    :param rooms: Number of rooms.
    :param min_size_m: Smallest size along x, y (height) and z; ``max_size_m`` the largest.
    :param absorption: Least and largest absorption coefficient of a room; uniform in the logarithm.
    :param settings: Keys of the acoustics over the preset, as ``earshot rir --set``.
    """

    def __init__(
        self,
        rooms: int = 100,
        per_room: int = 20,
        *,
        seed: int = 0,
        rate_hz: float = 16000,
        length_s: float = 0.5,
        channels: str = "mono",
        min_size_m: tuple[float, float, float] = (3, 2.4, 3),
        max_size_m: tuple[float, float, float] = (10, 4, 8),
        absorption: tuple[float, float] = (0.05, 0.5),
        preset: str = "fast",
        settings: Mapping[str, Any] | None = None,
    ) -> None:
        if rooms < 1 or per_room < 1:
            raise InputError(f"SimulatedResponses: rooms is {rooms}, per_room {per_room}; both must be at least 1")
        if not all(1.5 <= low <= high for low, high in zip(min_size_m, max_size_m, strict=True)):
            raise InputError(f"SimulatedResponses: sizes from {min_size_m} to {max_size_m}; they must be at least 1.5 m and in order")
        if not 0 < absorption[0] <= absorption[1] <= 1:
            raise InputError(f"SimulatedResponses: absorption is {absorption}; give LOW, HIGH in (0, 1]")
        self.rate_hz = float(rate_hz)
        self._settings: dict[str, Any] = {
            "rooms": rooms,
            "per_room": per_room,
            "seed": seed,
            "rate_hz": rate_hz,
            "length_s": length_s,
            "channels": channels,
            "min_size_m": min_size_m,
            "max_size_m": max_size_m,
            "absorption": absorption,
            "preset": preset,
            "settings": dict(settings or {}),
        }
        self._kept = _Kept()
        self._scenes: OrderedDict[int, Any] = OrderedDict()

    def __reduce__(self) -> tuple[Any, ...]:
        return _simulated_responses, (self._settings,)

    def __len__(self) -> int:
        return int(self._settings["rooms"] * self._settings["per_room"])

    def __getitem__(self, index: int) -> NDArray[np.float32]:
        if not 0 <= index < len(self):
            raise IndexError(f"response {index} of {len(self)}")
        return self._kept.get(index, self._simulate)

    def labels(self, index: int) -> dict[str, Any]:
        source, listener, _ = self._places(index)
        return {
            "response": index,
            "scene": self._spec(index // self._settings["per_room"])[0],
            "distance_m": float(np.linalg.norm(source - listener)),
        }

    def _spec(self, room: int) -> tuple[str, NDArray[np.float64]]:
        draw = stream(Purpose.room, self._settings["seed"], 0, room)
        low, high = (np.array(self._settings[key], dtype=np.float64) for key in ("min_size_m", "max_size_m"))
        size = np.round(low + draw.random(3) * (high - low), 2)
        least, most = self._settings["absorption"]
        absorption = least * (most / least) ** draw.random()
        return f"shoebox:{size[0]:.2f}x{size[1]:.2f}x{size[2]:.2f}@{absorption:.3f}", size

    def _places(self, index: int) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        _, size = self._spec(index // self._settings["per_room"])
        draw = stream(Purpose.place, self._settings["seed"], 0, index)
        source = 0.5 + draw.random(3) * (size - 1)
        for _ in range(1000):  # a room of 1.5 m has places 0.5 m apart
            listener = 0.5 + draw.random(3) * (size - 1)
            if np.linalg.norm(source - listener) >= 0.5:
                break
            source = 0.5 + draw.random(3) * (size - 1)
        return source, listener, float(360 * draw.random())

    def _simulate(self, index: int) -> NDArray[np.float32]:
        room = index // self._settings["per_room"]
        source, listener, heading = self._places(index)
        rir = self._scene(room).source(source).render(listener, heading_deg=heading, channels=self._settings["channels"], threads=1)
        return np.asarray(rir, dtype=np.float32)

    def _scene(self, room: int) -> Any:
        if room not in self._scenes:
            from ..acoustics import Scene

            settings = {"field": "off", **self._settings["settings"], "rir_length_s": self._settings["length_s"]}
            self._scenes[room] = Scene(
                self._spec(room)[0], preset=self._settings["preset"], settings=settings, rate_hz=self._settings["rate_hz"], seed=0
            )
            if len(self._scenes) > 16:
                self._scenes.popitem(last=False)
        return self._scenes[room]


def _simulated_responses(settings: dict[str, Any]) -> SimulatedResponses:
    rest = {key: value for key, value in settings.items() if key not in ("rooms", "per_room")}
    return SimulatedResponses(settings["rooms"], settings["per_room"], **rest)


class _Kept:
    """The responses that were used last, up to 256 MiB."""

    def __init__(self) -> None:
        self._arrays: OrderedDict[int, NDArray[np.float32]] = OrderedDict()
        self._bytes = 0

    def get(self, number: int, make: Any) -> NDArray[np.float32]:
        found = self._arrays.pop(number, None)
        if found is None:
            found = make(number)
            self._bytes += found.nbytes
        self._arrays[number] = found
        while self._bytes > _KEPT_BYTES and len(self._arrays) > 1:
            self._bytes -= self._arrays.popitem(last=False)[1].nbytes
        result: NDArray[np.float32] = found
        return result


def _within(value: float | None, given: tuple[float, float] | None) -> bool:
    return given is None or (value is not None and given[0] <= value <= given[1])
