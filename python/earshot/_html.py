# SPDX-License-Identifier: Apache-2.0
"""What notebooks show: a plan as SVG, tables, a spectrogram as PNG, a player.  Needs numpy alone."""

from __future__ import annotations

import base64
import html
import struct
import zlib
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ._wav import wav

if TYPE_CHECKING:
    from ._results import AccuracyPlan, Metrics
    from .acoustics import Scene
    from .responses import Response

PLAN_PX = 360
MOST_WALLS = 4000
SPECTROGRAM_SAMPLES, SPECTROGRAM_HOP = 256, 64
SPECTROGRAM_DB = 80.0
METRIC_ROWS = (
    ("T20", "t20_s", "s"),
    ("EDT", "edt_s", "s"),
    ("C50", "c50_db", "dB"),
    ("C80", "c80_db", "dB"),
    ("D50", "d50", ""),
    ("centre time", "ts_s", "s"),
    ("DRR", "drr_band_db", "dB"),
    ("G", "g_db", "dB"),
)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Cells are texts, not HTML."""

    def line(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    return "<table>" + line(head, "th") + "".join(line(row, "td") for row in rows) + "</table>"


def _number(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.3g}"  # noqa: RUF001  # a dash: no such value


def plan_svg(scene: Scene, marks: Sequence[tuple[NDArray[np.float64], str, str]] = ()) -> str:
    """marks: position [3], colour and name."""
    low, high = scene.bounds[:, [0, 2]]
    margin = 0.03 * float((high - low).max())
    low, high = low - margin, high + margin
    scale = PLAN_PX / float((high - low).max())
    width, height = (high - low) * scale
    walls = (scene.section()[:, :, [0, 2]] - low) * scale
    path = "".join(f"M{a[0]:.1f} {a[1]:.1f}L{b[0]:.1f} {b[1]:.1f}" for a, b in walls[:MOST_WALLS])
    dots = ""
    for position, colour, name in marks:
        x, y = (position[[0, 2]] - low) * scale
        dots += f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" fill="{colour}"><title>{html.escape(name)}</title></circle>'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" viewBox="0 0 {width:.1f} {height:.1f}">'
        f'<path d="{path}" stroke="#444" stroke-width="1.5" fill="none"/>{dots}</svg>'
    )


def scene_page(scene: Scene, source: NDArray[np.float64] | None = None) -> str:
    size = scene.bounds[1] - scene.bounds[0]
    rows = [
        ("size", " x ".join(f"{value:.3g}" for value in size) + " m (x, y, z)"),
        ("triangles", f"{scene.num_triangles:,}"),
        ("sample rate", f"{scene.sample_rate_hz:g} Hz"),
        *(("warning", line) for line in scene.warnings),
    ]
    marks = [] if source is None else [(source, "#d62728", "source")]
    return f"<div><b>{html.escape(scene.name)}</b><br>{plan_svg(scene, marks)}{table(('', ''), rows)}</div>"


def metrics_table(metrics: Metrics) -> str:
    head = ["", *(f"{band:g} Hz" for band in metrics.bands_hz)]
    rows = [[f"{name} ({unit})" if unit else name, *map(_number, getattr(metrics, key))] for name, key, unit in METRIC_ROWS]
    return table(head, rows) + f"<p>DRR {_number(metrics.drr_db)} dB, direct sound after {_number(1000 * metrics.direct_delay_s)} ms</p>"


def accuracy_table(plan: AccuracyPlan) -> str:
    rows = []
    for choice in plan.tried:
        errors = ", ".join(f"{key} {_number(value)}" for key, value in choice.predicted.items())
        settings = ", ".join(f"{key}={value}" for key, value in choice.settings.items())
        rows.append(["chosen" if choice is plan.choice else "", choice.method, errors, f"{choice.per_response_ms:.3g} ms", settings])
    return table(["", "method", "predicted errors", "one response", "settings"], rows)


def png(pixels: NDArray[np.uint8]) -> bytes:
    """Grey, [rows, columns]."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows, columns = pixels.shape
    lines = b"".join(b"\0" + line.tobytes() for line in np.ascontiguousarray(pixels))
    header = struct.pack(">IIBBBBB", columns, rows, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b"")


def spectrogram_db(samples: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """[frequencies, times] of one channel, against its largest value, frequencies low to high."""
    padded = np.pad(np.asarray(samples, dtype=np.float64), (0, SPECTROGRAM_SAMPLES))
    frames = np.lib.stride_tricks.sliding_window_view(padded, SPECTROGRAM_SAMPLES)[::SPECTROGRAM_HOP]
    power = np.abs(np.fft.rfft(frames * np.hanning(SPECTROGRAM_SAMPLES), axis=1)).T ** 2
    largest = power.max() or 1.0
    levels: NDArray[np.float64] = 10 * np.log10(np.maximum(power / largest, 10 ** (-SPECTROGRAM_DB / 10)))
    return levels


def audible(samples: NDArray[np.floating[Any]]) -> NDArray[np.int16]:
    """Its peak at 0.9."""
    peak = float(np.abs(samples).max()) or 1.0
    return np.round(np.asarray(samples) / peak * 0.9 * 32767).astype(np.int16)


def inline(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def response_page(response: Response) -> str:
    scene, rir = response.source.scene, response.render()
    marks = [(response.source.position, "#d62728", "source"), (response.listener, "#1f77b4", "listener")]
    levels = np.vstack([spectrogram_db(channel)[::-1] for channel in rir[:2]])
    grey = np.round((levels / SPECTROGRAM_DB + 1) * 255).astype(np.uint8)
    seconds = rir.shape[1] / scene.sample_rate_hz
    caption = f"Spectrogram over {seconds:.3g} s, 0 to {scene.sample_rate_hz / 2000:g} kHz, {SPECTROGRAM_DB:g} dB; first channel on top"
    player = f'<audio controls src="{inline("audio/wav", wav(audible(rir[:2]), scene.sample_rate_hz))}"></audio>'
    image = f'<img alt="spectrogram" style="width:{PLAN_PX}px;image-rendering:pixelated" src="{inline("image/png", png(grey))}">'
    return (
        f"<div>{plan_svg(scene, marks)}<br>{html.escape(repr(response.arrivals))}{metrics_table(response.metrics)}"
        f"{image}<br><small>{caption}</small><br>{player}</div>"
    )
