# SPDX-License-Identifier: Apache-2.0
"""A corpus of `earshot dataset` in parts that any process can make: one part is one numbered folder of the corpus."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._engine import InputError, RunError
from ._program import find_program, run_program, text_arguments

#: Commands of `earshot dataset` whose corpora lie in numbered folders.
COMMANDS = ("rir", "convolve", "scenes", "pano")
_REFUSED = {
    "--out": "is the argument out",
    "--shard": "is set for each part",
    "--threads": "is the argument cpus_per_part",
}
#: Folder f is the only one of shard f + 1 of so many (datasets/corpus_parts.h); the last shard of all has none.
_SHARDS = 1_000_000
_MISSING = re.compile(r": (\d+) folders of other shards are missing;")
#: Records of the whole corpus, which let a part know that it belongs to it.
_RECORDS = ("corpus.json", "inputs.jsonl")


@dataclasses.dataclass(frozen=True)
class Bundle:
    """Files in one array: Ray and Dask move arrays without copies."""

    names: tuple[str, ...]
    ends: tuple[int, ...]
    data: NDArray[np.uint8]

    @staticmethod
    def of(folder: Path, names: Sequence[str]) -> Bundle:
        sizes = [os.path.getsize(folder / name) for name in names]
        ends = tuple(int(end) for end in np.cumsum(sizes))
        data = np.empty(ends[-1] if ends else 0, np.uint8)
        for name, size, end in zip(names, sizes, ends, strict=True):
            with open(folder / name, "rb") as file:
                if size and file.readinto(data[end - size : end].data) != size:
                    raise RunError(f"{folder / name}: was cut while it was read")
        return Bundle(tuple(names), ends, data)

    def files(self) -> Iterator[tuple[str, memoryview]]:
        begin = 0
        for name, end in zip(self.names, self.ends, strict=True):
            yield name, self.data[begin:end].data
            begin = end


@dataclasses.dataclass(frozen=True)
class Plan:
    """All that a part depends on: the same on each node."""

    program: str
    command: str  #: of COMMANDS
    arguments: tuple[str, ...]
    cwd: str  #: to which paths in the arguments are relative
    records: Mapping[str, bytes]
    missing: tuple[int, ...]  #: numbers of the folders that are not there
    out: str

    def part_arguments(self, out: str, folder: int, threads: int) -> list[str]:
        shard = f"{folder + 1}/{_SHARDS}"
        return [self.program, "dataset", self.command, *self.arguments, "--out", out, "--shard", shard, "--threads", str(threads)]


def plan(
    command: str, arguments: Sequence[str | os.PathLike[str]], out: str | os.PathLike[str], program: str | os.PathLike[str] | None
) -> Plan:
    """Begins the corpus in `out`, or finds what is missing of it.  Refuses wrong arguments before any part is made."""
    if command not in COMMANDS:
        raise InputError(f"corpus: command {command!r} is none that is made in parts; use one of {', '.join(COMMANDS)}")
    texts = text_arguments(f"corpus {command}", arguments, _REFUSED)
    begun = Plan(find_program(program), command, tuple(texts), os.getcwd(), {}, (), os.path.abspath(out))
    said = run_program(begun.part_arguments(begun.out, _SHARDS - 1, 1), cwd=begun.cwd)
    found = _MISSING.search(said)
    count = int(found.group(1)) if found else 0  # none: the manifests of the whole are written
    _require_whole(begun.out, count)
    missing: list[int] = []
    number = 0
    while len(missing) < count:
        if not (Path(begun.out) / f"{number:05}" / "manifest.jsonl").exists():
            missing.append(number)
        number += 1
    records = {name: (Path(begun.out) / name).read_bytes() for name in _RECORDS if (Path(begun.out) / name).exists()}
    return dataclasses.replace(begun, records=records, missing=tuple(missing))


def make_part(work: Plan, folder: int, threads: int, scratch: str | None, mark: str = "") -> Bundle:
    """The files of one folder, made in a folder of this node that is removed afterwards.  mark: part of the name of that folder."""
    with tempfile.TemporaryDirectory(prefix=f"earshot-{mark}part-{folder}-", dir=scratch) as below:
        out = Path(below) / "corpus"
        out.mkdir()
        for name, data in work.records.items():
            (out / name).write_bytes(data)
        run_program(work.part_arguments(str(out), folder, threads), cwd=work.cwd)
        for name, data in work.records.items():
            if (out / name).read_bytes() != data:
                raise RunError(f"{name}: differs on this node; nodes need the same files")
        made = out / f"{folder:05}"
        return Bundle.of(made, sorted(str(path.relative_to(made)) for path in made.rglob("*") if path.is_file()))


def make_part_in_place(work: Plan, folder: int, threads: int) -> int:
    """Writes one folder of the corpus itself, which this node must see, and returns the number of its recordings."""
    record = Path(work.out) / _RECORDS[0]
    if not record.exists() or record.read_bytes() != work.records[_RECORDS[0]]:
        raise InputError(f"{work.out}: a node does not see this folder of the caller; leave shared out, or use a shared file system")
    run_program(work.part_arguments(work.out, folder, threads), cwd=work.cwd)
    return (Path(work.out) / f"{folder:05}" / "manifest.jsonl").read_bytes().count(b"\n")


def keep_part(out: str, folder: int, files: Bundle) -> int:
    """Writes the files of a folder, its manifest last, and returns the number of its recordings.  As the program does, it leaves nothing
    that looks complete and is not: the folder is renamed once all of it is on the disk."""
    target = Path(out) / f"{folder:05}"
    unfinished = Path(out) / f"{folder:05}.unfinished"
    shutil.rmtree(unfinished, ignore_errors=True)
    lines = 0
    for name, data in files.files():
        path = unfinished / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(path, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if name == "manifest.jsonl":
            lines = bytes(data).count(b"\n")
    for path in [*(path for path in unfinished.rglob("*") if path.is_dir()), unfinished]:
        _flush(path)
    shutil.rmtree(target, ignore_errors=True)  # rooms of an interrupted run of the program, which are in the new one
    os.rename(unfinished, target)
    _flush(Path(out))
    return lines


def join(work: Plan) -> None:
    """Writes the manifests of the whole, once no folder is missing."""
    said = run_program(work.part_arguments(work.out, _SHARDS - 1, 1), cwd=work.cwd)
    if _MISSING.search(said):
        raise RunError(f"{work.out}: folders are missing although all parts were made; run the same call again")
    _require_whole(work.out, 0)


def _require_whole(out: str, missing: int) -> None:
    """Nothing is missing only where the manifest of the whole is there."""
    if missing == 0 and not (Path(out) / "manifest.jsonl").exists():
        raise RunError(f"{out}: the program did not say what is missing; use the program of this package")


def _flush(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def rows_of(lines: str) -> list[dict[str, Any]]:
    """The lines of a manifest."""
    return [json.loads(line) for line in lines.splitlines()]
