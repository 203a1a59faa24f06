# SPDX-License-Identifier: Apache-2.0
"""Folders of ``earshot dataset rir`` and ``dataset pano``."""

from __future__ import annotations

import hashlib
import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._engine import InputError
from ._wav_reader import read_wav

_VERSION_KEY = "earshot_corpus"
_NEWEST = 1
#: Keys of a line of the manifest, with what becomes of each in a table; None: a path within the corpus.
KEYS: dict[str, str | None] = {
    "id": "text",
    "file": None,
    "early_file": None,
    "late_file": None,
    "rgb_file": None,
    "depth_file": None,
    "category_file": None,
    "split_sample": "whole",
    "scene": "text",
    "scene_hash": "text",
    "room": "whole",
    "source": "source",
    "listener": "listener",
    "distance_m": "number",
    "azimuth_deg": "number",
    "elevation_deg": "number",
    "line_of_sight": "flag",
    "direct_delay_s": "number",
    "drr_db": "number",
    "t20_mid_s": "number",
    "t20_s": "numbers",
    "rt60_s": "numbers",
    "c50_db": "numbers",
    "t20_error_s": "numbers",
    "field_t20_error": "number",
    "num_samples": "whole",
    "gain": "number",
}
_REQUIRED = ("id", "file", "scene", "room", "source", "listener", "t20_mid_s", "num_samples", "gain")
_MID_HZ = (400, 1250)  # the octaves at 500 Hz and 1 kHz
_GRADES = ((0.05, "A"), (0.1, "B"))  # largest relative error of T20
_GENERATED = ("shoebox:", "house:", "floor:")


class Corpus:
    """A complete corpus of responses with their labels.

    :param folder: What ``earshot dataset rir`` wrote as ``--out``.
    :raises InputError: The folder is no corpus of responses, or is incomplete or damaged.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)
        if not self.folder.is_dir():
            raise InputError(f"{self.folder}: is no folder; give a folder written by 'earshot dataset rir'")
        description = self.folder / "corpus.json"
        if not description.exists():
            raise InputError(f"{self.folder}: contains no corpus.json; give a folder written by 'earshot dataset rir'")
        text = _read(description)
        try:
            self.description: dict[str, Any] = json.loads(text)
            version = self.description[_VERSION_KEY]
            self.rate_hz = float(self.description["sample_rate_hz"])
            self.channels = [str(channel) for channel in self.description["channels"]]
            count = int(self.description["responses"]) if "responses" in self.description else None
        except (ValueError, KeyError, TypeError):
            raise InputError(f"{description}: is no description of a corpus; write the corpus again") from None
        if version != _NEWEST:
            raise InputError(f"{description}: has version {version} of corpora, this package reads {_NEWEST}; use a package as new as it")
        if count is None:
            raise InputError(f"{self.folder}: holds no responses; give a folder of 'earshot dataset rir' or 'dataset pano'")
        manifest = self.folder / "manifest.jsonl"
        if not manifest.exists():
            raise InputError(f"{self.folder}: contains an incomplete corpus; run the command that began it again, for all shards")
        lines = _read(manifest)
        #: One dict per response (docs/howto/datasets.md#files).
        self.lines: list[dict[str, Any]] = [_line(line, f"{manifest}:{i}") for i, line in enumerate(lines.splitlines(), 1)]
        if len(self.lines) != count:
            raise InputError(f"{manifest}: has {len(self.lines)} lines for {count} responses; write the corpus again")
        if any(line["file"].endswith(".sofa") for line in self.lines):
            raise InputError(f"{self.folder}: stores its responses in SOFA files; write the corpus with format wav or flac")
        #: Of both files: the same corpus.
        self.hash = hashlib.sha256(text + b"\0" + lines).hexdigest()

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def bands_hz(self) -> list[float]:
        """Centres of the octaves of the labels."""
        return [float(hz) for hz in self.description.get("bands_hz", [])]

    def file(self, path: str) -> bytes:
        """The bytes of a file that the manifest names."""
        if Path(path).is_absolute() or ".." in Path(path).parts:
            raise InputError(f"{self.folder}: names the file {path!r} outside of itself; write the corpus again")
        return _read(self.folder / path)

    def response(self, index: int) -> NDArray[np.float32]:
        """The samples [channels, samples] in pressure per unit source, as the program computed them."""
        line = self.lines[index]
        path = str(line["file"])
        if path.endswith(".flac"):
            samples, rate = _read_flac(self.file(path), str(self.folder / path))
        else:
            samples, rate = read_wav(self.file(path), str(self.folder / path))
        if samples.shape[0] != len(self.channels) or rate != round(self.rate_hz):
            raise InputError(f"{self.folder / path}: has another rate or number of channels than its corpus; write the corpus again")
        return samples if line["gain"] == 1 else samples / np.float32(line["gain"])

    def t20_error(self, index: int) -> float | None:
        """Relative standard error of ``t20_mid_s`` as the corpus states it for both octaves or for its field; None without one."""
        line = self.lines[index]
        errors, times = line.get("t20_error_s") or [], line.get("t20_s") or []
        mid = [i for i, hz in enumerate(self.bands_hz) if _MID_HZ[0] <= hz <= _MID_HZ[1] and i < min(len(errors), len(times))]
        if mid and all(errors[i] is not None and times[i] for i in mid):
            # The octaves share their rays, so their errors add.
            return float(sum(errors[i] for i in mid) / sum(times[i] for i in mid))
        field = line.get("field_t20_error")
        return None if field is None else float(field)

    def inputs(self) -> list[str]:
        """Files that the corpus was made from, in alphabetical order: scenes, heads, microphones and patterns of sources."""
        found = {str(line["scene"]) for line in self.lines}
        for line in self.lines:
            found.add(_file_of(str(line["source"].get("pattern", ""))))
            found.add(_file_of(str(line["listener"].get("hrtf", ""))))
        for key in ("hrtf", "channels"):
            value = re.search(rf"^{key}: (.*)$", str(self.description.get("config", "")), re.MULTILINE)
            found.add(_file_of(value.group(1).strip().strip("\"'").removeprefix("array:").removeprefix("mono:")) if value else "")
        return sorted(name for name in found if name and not name.startswith(_GENERATED))


def grade_of(t20_error: float | None) -> str | None:
    """A: within the just-noticeable difference of 5 % (ISO 3382-1:2009, Annex A), B: within 10 %, C: above; None: no error is stated."""
    if t20_error is None:
        return None
    return next((grade for limit, grade in _GRADES if t20_error <= limit), "C")


def _file_of(text: str) -> str:
    """The text if it names a file."""
    return text if re.search(r"\.[A-Za-z0-9]{2,5}$", text) else ""


def _line(text: bytes, where: str) -> dict[str, Any]:
    try:
        line = json.loads(text)
        if not isinstance(line, dict):
            raise ValueError
    except ValueError:
        raise InputError(f"{where}: is no line of a manifest; write the corpus again") from None
    unknown = next((key for key in line if key not in KEYS and key != "measurement"), None)
    if unknown is not None:
        raise InputError(f"{where}: has the key {unknown!r}, which this package does not know; use a package as new as the corpus")
    missing = next((key for key in _REQUIRED if key not in line), None)
    if missing is not None:
        raise InputError(f"{where}: lacks the key {missing!r}; write the corpus again")
    return line


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); write the corpus again") from None


def _read_flac(data: bytes, name: str) -> tuple[NDArray[np.float32], int]:
    import io

    from ..integrations._common import require

    soundfile = require("soundfile", "data")
    try:
        samples, rate = soundfile.read(io.BytesIO(data), dtype="float32", always_2d=True)
    except RuntimeError as error:
        raise InputError(f"{name}: is no FLAC file ({error})") from None
    return np.ascontiguousarray(samples.T), int(rate)
