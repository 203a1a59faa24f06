# SPDX-License-Identifier: Apache-2.0
"""The curves of a training run, read from its folder while it trains."""

from __future__ import annotations

import dataclasses
import fcntl
import json
import os
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from .._engine import InputError, RunError

LEASE_S = 60.0  #: a lock file on a shared file system is renewed more often
_FLOCK = "hhqqi4x"  # struct flock of 64-bit Linux


@dataclasses.dataclass(frozen=True)
class Point:
    """A line of events.jsonl: an update, or an evaluation on held-out episodes behind it."""

    update: int
    env_steps: int
    wall_s: float  #: since the run began, pauses left out
    values: dict[str, float]  #: by name; values that are missing are left out

    @property
    def is_held_out(self) -> bool:
        return any(name.startswith("held_out/") for name in self.values)


def points(folder: str | os.PathLike[str]) -> list[Point]:
    """The points that a run has written.  Raises InputError without a run."""
    return list(_Curve(Path(folder)).new())


def follow(folder: str | os.PathLike[str], *, poll_s: float = 1.0, wait_s: float = 0.0) -> Iterator[Point]:
    """The points of a run as it writes them, each once, until it ends.

    A resumed run that cuts its curve repeats points with the same values; they are left out.

    :param poll_s: Time between two looks at the folder.
    :param wait_s: Time that the run may take to begin.
    :raises InputError: There is no run after `wait_s`.
    :raises RunError: Another run replaces the curve (``--overwrite``).
    """
    curve = _Curve(Path(folder))
    end = time.monotonic() + wait_s
    while not curve.path.exists() and time.monotonic() < end:
        time.sleep(min(poll_s, 0.1))
    seen: set[tuple[int, bool]] = set()
    while True:
        under_way = is_under_way(folder)  # before the look: no point is written after the end
        for point in curve.new():
            key = (point.update, point.is_held_out)
            if key not in seen:
                seen.add(key)
                yield point
        if not under_way:
            return
        time.sleep(poll_s)


def is_under_way(folder: str | os.PathLike[str]) -> bool:
    """Whether a process holds the lock on the folder of a run."""
    try:
        with open(Path(folder) / "run.lock", "rb") as lock:
            asked = struct.pack(_FLOCK, fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)
            holder = struct.unpack(_FLOCK, fcntl.fcntl(lock, fcntl.F_GETLK, asked))[0]
            return bool(holder != fcntl.F_UNLCK) or time.time() - os.fstat(lock.fileno()).st_mtime < LEASE_S
    except FileNotFoundError:
        return False
    except OSError:
        return True  # a file system without locks: the file is there


class _Curve:
    """What an events.jsonl has beyond what was read of it."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "events.jsonl"
        self.first = b""
        self.last = b""  #: ends at the offset
        self.offset = 0
        self.line = 0

    def new(self) -> Iterator[Point]:
        try:
            with open(self.path, "rb") as file:
                self._rewind_if_cut(file)
                lines = file.readlines()  # at once: the file may be cut before the caller asks for the next point
        except FileNotFoundError:
            raise InputError(f"{self.path.parent}: has no events.jsonl; name the folder of a training run") from None
        for line in lines:
            if not line.endswith(b"\n"):
                return  # torn: the rest follows
            self.first = self.first or line
            self.last = line
            self.offset += len(line)
            self.line += 1
            yield self._point(line)

    def _rewind_if_cut(self, file: BinaryIO) -> None:
        if self.first and file.readline() != self.first:
            raise RunError(f"{self.path}: another run has taken the folder; follow it anew")
        file.seek(self.offset - len(self.last))
        if file.read(len(self.last)) != self.last:  # cut, and maybe longer again, with other times in its lines
            self.offset = self.line = 0
            self.last = b""
        file.seek(self.offset)

    def _point(self, line: bytes) -> Point:
        try:
            found = json.loads(line)
            values = {str(name): float(value) for name, value in found["values"].items() if value is not None}
            return Point(int(found["update"]), int(found["env_steps"]), float(found["wall_s"]), values)
        except (ValueError, KeyError, TypeError, AttributeError):
            raise InputError(f"{self.path}:{self.line}: is no point of a curve") from None
