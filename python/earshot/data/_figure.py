# SPDX-License-Identifier: Apache-2.0
"""The distribution of reverberation times of a corpus as a figure."""

from __future__ import annotations

import math
import os
from html import escape

import numpy as np

from .._engine import InputError
from ._corpus import Corpus
from ._files import write_text

_WIDTH, _HEIGHT = 640, 360
_LEFT, _RIGHT, _TOP, _BOTTOM = 64, 16, 44, 52


def rt60_figure(folder: str | os.PathLike[str], out: str | os.PathLike[str] | None = None, *, title: str = "") -> str:
    """Return an SVG picture of the distribution of ``t20_mid_s``: responses per bin, with median and the range of the middle 90 %.

    :param folder: What ``earshot dataset rir`` or ``dataset pano`` wrote as ``--out``.
    :param out: File to write it to as well.
    :raises InputError: No complete corpus, or none of its responses has a reverberation time.
    """
    from pathlib import Path

    corpus = Corpus(folder)
    times = np.array([line["t20_mid_s"] for line in corpus.lines if line["t20_mid_s"] is not None], dtype=np.float64)
    if not len(times):
        raise InputError(f"{corpus.folder}: states no reverberation time; use longer responses (acoustics.rir_length_s)")
    svg = _draw(times, len(corpus), title or corpus.folder.resolve().name)
    if out is not None:
        write_text(Path(out), svg)
    return svg


def _draw(times: np.ndarray[tuple[int], np.dtype[np.float64]], responses: int, title: str) -> str:
    width = _nice(max(float(times.max()) / 30, 1e-4))
    bins = int(times.max() / width) + 1
    counts = np.bincount(np.minimum((times / width).astype(np.int64), bins - 1), minlength=bins)
    high = float(counts.max())
    step = max(1.0, _nice(high / 4))
    top = step * math.ceil(high / step)
    span_x, span_y = _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM

    def x(seconds: float) -> float:
        return _LEFT + span_x * seconds / (bins * width)

    def y(count: float) -> float:
        return _TOP + span_y * (1 - count / top)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" font-family="sans-serif" font-size="13" role="img">',
        f"<title>{escape(title)}: distribution of reverberation times</title>",
        f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="#ffffff"/>',
    ]
    for tick in np.arange(0, top + step / 2, step):
        parts.append(f'<line x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{y(tick):.1f}" y2="{y(tick):.1f}" stroke="#dddddd"/>')
        parts.append(f'<text x="{_LEFT - 8}" y="{y(tick) + 4:.1f}" text-anchor="end">{tick:,.0f}</text>')
    for i, count in enumerate(counts):
        if count:
            left, right = x(i * width), x((i + 1) * width)
            parts.append(
                f'<rect x="{left + 0.5:.1f}" y="{y(count):.1f}" width="{max(0.5, right - left - 1):.1f}" height="{y(0) - y(count):.1f}"'
                ' fill="#3b6ea5"/>'
            )
    across = _nice(bins * width / 8)
    for tick in np.arange(0, bins * width + across / 100, across):
        parts.append(f'<line x1="{x(tick):.1f}" x2="{x(tick):.1f}" y1="{y(0):.1f}" y2="{y(0) + 5:.1f}" stroke="#333333"/>')
        parts.append(f'<text x="{x(tick):.1f}" y="{y(0) + 19:.1f}" text-anchor="middle">{tick:g}</text>')
    low, middle, up = np.quantile(times, [0.05, 0.5, 0.95])
    parts.append(f'<line x1="{x(middle):.1f}" x2="{x(middle):.1f}" y1="{_TOP}" y2="{y(0):.1f}" stroke="#b03a2e" stroke-width="1.5"/>')
    parts.append(f'<line x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{y(0):.1f}" y2="{y(0):.1f}" stroke="#333333"/>')
    without = f", {responses - len(times):,} without" if len(times) < responses else ""
    parts.append(f'<text x="{_LEFT}" y="20" font-weight="bold">{escape(title)}</text>')
    summary = f"{len(times):,} responses{without}; median {middle:.2f} s, middle 90 % from {low:.2f} to {up:.2f} s"
    parts.append(f'<text x="{_LEFT}" y="37">{summary}</text>')
    below = "reverberation time T20, mean of 500 Hz and 1 kHz, in s"
    parts.append(f'<text x="{_LEFT + span_x / 2:.1f}" y="{_HEIGHT - 10}" text-anchor="middle">{below}</text>')
    parts.append(
        f'<text x="16" y="{_TOP + span_y / 2:.1f}" text-anchor="middle" transform="rotate(-90 16 {_TOP + span_y / 2:.1f})">responses per'
        f" {width:g} s</text>"
    )
    return "\n".join([*parts, "</svg>", ""])


def _nice(value: float) -> float:
    """The least of 1, 2 and 5 times a power of ten that is not below."""
    power = 10.0 ** np.floor(np.log10(value))
    return next((float(np.round(step * power, 12)) for step in (1, 2, 5) if step * power >= value * (1 - 1e-9)), float(10 * power))
