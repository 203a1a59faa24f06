# SPDX-License-Identifier: Apache-2.0
"""Files behind arguments: pickles carry hashes of their bytes, and refuse other bytes."""

from __future__ import annotations

import os
from collections.abc import Sequence

from . import _engine
from ._engine import InputError

Files = list[tuple[str, int]]  #: name and hash of each

_BALLOONS = (".json", ".yaml", ".yml")
_MEASURED = (".sofa", ".tab", ".txt", ".clf", ".cf1", ".cf2")  #: in any case


def channel_files(channels: str) -> Files:
    """Of ``array:FILE`` with its patterns, or of ``mono:FILE``."""
    return _engine.files_of_channels(channels) if channels.startswith(("array:", "mono:")) else []


def pattern_files(pattern: str) -> Files:
    """Of the pattern of a source."""
    return channel_files(f"mono:{pattern}") if pattern.endswith(_BALLOONS) or pattern.lower().endswith(_MEASURED) else []


def with_absolute_path(text: str, files: Files) -> str:
    """The pattern or channels, so that another folder finds the first of the files."""
    if not files:
        return text
    path = files[0][0]
    return text.removesuffix(path) + os.path.abspath(path)


def require_same(before: Files, after: Files, since: str) -> None:
    """Refuse hashes that differ, in the order of the files.  since: "the source was pickled"."""
    changed = _first_change(before, after)
    if changed is not None:
        raise InputError(f"{changed}: has changed since {since}; make it again from the file as it is")


def _first_change(before: Files, after: Files) -> str | None:
    hashes: Sequence[int] = [number for _, number in after]
    for index, (name, number) in enumerate(before):
        if index >= len(hashes) or hashes[index] != number:
            return name
    return after[len(before)][0] if len(after) > len(before) else None
