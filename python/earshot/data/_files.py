# SPDX-License-Identifier: Apache-2.0
"""Output folders that a stopped run leaves whole files in, and no others."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from .._engine import InputError, RunError

_SETTINGS = "export.json"


@contextlib.contextmanager
def told_by_path(path: Path) -> Iterator[None]:
    """Turn errors of the system into one line."""
    try:
        yield
    except OSError as error:
        raise RunError(f"{path}: cannot be written ({error.strerror}); make room and run the same command again") from None


def write_whole(path: Path, write: Callable[[BinaryIO], None]) -> None:
    """Write a file under a temporary name, then rename it: a reader never sees a part of it."""
    part = path.with_name(f".{path.name}.part")
    with told_by_path(path):
        try:
            with open(part, "wb") as file:
                write(file)
                file.flush()
                os.fsync(file.fileno())
            os.replace(part, path)
        except BaseException:
            part.unlink(missing_ok=True)
            raise


def begin(out: Path, settings: dict[str, Any]) -> None:
    """Make the folder, or go on with one of the same settings.  Settings are compared before anything is written."""
    text = json.dumps(settings, indent=1, ensure_ascii=False) + "\n"
    with told_by_path(out):
        if out.exists() and not out.is_dir():
            raise InputError(f"{out}: is no folder; give another --out")
        out.mkdir(parents=True, exist_ok=True)
        there = out / _SETTINGS
        if there.exists():
            _compare(there, settings)
            return
        foreign = next((entry for entry in sorted(out.iterdir()) if entry.name != f".{_SETTINGS}.part"), None)
    if foreign is not None:
        raise InputError(f"{out}: holds other files, such as {foreign.name}; give an empty folder as --out")
    write_whole(there, lambda file: _write(file, text.encode()))


def _write(file: BinaryIO, data: bytes) -> None:
    file.write(data)


def write_text(path: Path, text: str) -> None:
    write_whole(path, lambda file: _write(file, text.encode()))


def _compare(there: Path, settings: dict[str, Any]) -> None:
    try:
        before = json.loads(there.read_bytes())
        if not isinstance(before, dict):
            raise ValueError
    except ValueError:
        raise InputError(f"{there}: is damaged; remove the folder and run the command again") from None
    for key in {**settings, **before}:
        if before.get(key) != settings.get(key):
            raise InputError(
                f"{there.parent}: was begun with another {key} ({_short(before.get(key))} there, {_short(settings.get(key))} here);"
                " give another --out"
            )


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else text[:57] + "..."
