# SPDX-License-Identifier: Apache-2.0
"""Responses: what a listener receives from a source, before any head."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arguments as check
from . import _engine
from ._files import Files, channel_files, require_same, with_absolute_path
from ._results import Arrivals, Floats, Metrics

if TYPE_CHECKING:
    from .acoustics import Source


def place_text(position: Floats) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in position) + "]"


class ResponseCall:
    """The responses of one call.  Whether they share a field depends on their number, so they are made together."""

    def __init__(self, source: Source, listeners: Floats, channels: str, threads: int = 0, files: Files | None = None) -> None:
        """files: those of the channels when the call was pickled; others are refused."""
        self.source = source
        self.listeners = listeners
        self.channels = channels
        self.threads = threads
        self._files = channel_files(channels)
        if files is not None:
            require_same(files, self._files, "the response was pickled")
        self._models: list[_engine.ResponseModel] | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        channels = with_absolute_path(self.channels, self._files)
        return ResponseCall, (self.source, self.listeners, channels, self.threads, self._files)

    def models(self) -> list[_engine.ResponseModel]:
        if self._models is None:
            self._models = self.source._model.respond(self.listeners, self.channels, self.threads)
            require_same(self._files, channel_files(self.channels), "the response was asked for")
        return self._models


class Response:
    """Energy response of one source and one listener, before a head or microphone.  It does not depend on the listener's orientation.

    >>> from earshot import Scene
    >>> room = Scene("shoebox:6x3x5", preset="fast", settings={"rir_length_s": 0.2})
    >>> response = room.source([2, 1.5, 2]).response([4, 1.5, 2])
    >>> response.arrivals.kind_names[0]
    'direct'
    >>> response.render(90).shape  # the head turned left by 90 degrees
    (2, 3200)
    """

    def __init__(self, call: ResponseCall, index: int) -> None:
        self._call = call
        self._index = index

    def __copy__(self) -> Response:
        return self

    def __deepcopy__(self, memo: object) -> Response:
        return self  # nothing of it changes

    def __repr__(self) -> str:
        return f"earshot.Response(listener {place_text(self.listener)}, {self._call.source!r})"

    def _repr_html_(self) -> str:
        from ._html import response_page

        return response_page(self)

    def plot(self, ax: Any = None) -> Any:
        """Draw paths and late energy over time with matplotlib (extra ``plot``).  Returns the axes."""
        from ._plots import plot_response

        return plot_response(self, ax)

    @property
    def _model(self) -> _engine.ResponseModel:
        return self._call.models()[self._index]

    @property
    def source(self) -> Source:
        return self._call.source

    @property
    def listener(self) -> Floats:
        """Position [3] in metres."""
        place: Floats = self._call.listeners[self._index].copy()
        return place

    @cached_property
    def arrivals(self) -> Arrivals:
        """Paths from the source, by distance."""
        return Arrivals(**self._model.arrivals())

    @cached_property
    def metrics(self) -> Metrics:
        """Parameters from the energy response: exact times, without carrier noise."""
        return Metrics(**self._model.metrics())

    def measure(self, parameters: Sequence[str] = (), *, speech_snr_db: ArrayLike = ()) -> Metrics:
        """Compute :attr:`metrics` with further parameters.

        :param parameters: Groups of "lateral" (J_LF, J_LFC, LG; needs ``settings={"sh_order": 4}``), "stage" (ST_early, ST_late; needs a
            listener at 1 m from the source), "speech" (MTI, STI) and "interaural" (errors of IACC, for :meth:`standard_errors`).
        :param speech_snr_db: Ratio of speech to noise for STI: one number, or seven from 125 Hz to 8 kHz; none by default.
        """
        where = "Response.measure"
        return Metrics(**self._model.measure(*check.parameters(parameters, speech_snr_db, where)))

    def standard_errors(
        self,
        parameters: Sequence[str] = (),
        *,
        speech_snr_db: ArrayLike = (),
        heading_deg: float = 0,
        pitch_deg: float = 0,
        roll_deg: float = 0,
        hrtf: str | os.PathLike[str] = "",
    ) -> Metrics:
        """Compute the standard error of each value of :meth:`measure`, in the field of that value; NaN where it is not known.

        Twice an error covers 95 % of seeds.  Takes one more trace; "interaural" also renders 16 times for the given head.
        """
        where = "Response.standard_errors"
        named = {"heading_deg": heading_deg, "pitch_deg": pitch_deg, "roll_deg": roll_deg}
        heading, pitch, roll = (check.number(value, where, name) for name, value in named.items())
        groups, ratios = check.parameters(parameters, speech_snr_db, where)
        return Metrics(**self._model.standard_errors(groups, ratios, heading, pitch, roll, check.path(hrtf, where, "hrtf")))

    @property
    def late(self) -> NDArray[np.float32]:
        """Energy of the late field, a read-only view [time bins, bands, harmonics]."""
        return self._model.late()

    @property
    def bin_s(self) -> float:
        """Length of a time bin of ``late`` in seconds; the first bin starts at emission."""
        return self._model.bin_s

    @property
    def speed_of_sound_m_per_s(self) -> float:
        return self._model.speed_of_sound_m_per_s

    @property
    def ray_efficiency(self) -> float:
        """Fraction of the traced rays that carry energy to the end, in [0, 1]."""
        return self._model.ray_efficiency

    def render(
        self,
        heading_deg: float = 0,
        *,
        pitch_deg: float = 0,
        roll_deg: float = 0,
        channels: str | None = None,
        hrtf: str | os.PathLike[str] = "",
    ) -> NDArray[np.float32]:
        """Render the impulse response [channels, samples] for this orientation of the listener.

        :param channels: Channel layout; the default is that of :meth:`Source.response`.
        :param hrtf: SOFA file of the head; empty for a rigid sphere.
        """
        where = "Response.render"
        named = {"heading_deg": heading_deg, "pitch_deg": pitch_deg, "roll_deg": roll_deg}
        heading, pitch, roll = (check.number(value, where, name) for name, value in named.items())
        wanted = self._call.channels if channels is None else check.text(channels, where, "channels")
        return self._model.render(heading, pitch, roll, wanted, check.path(hrtf, where, "hrtf"))
