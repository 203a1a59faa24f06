# SPDX-License-Identifier: Apache-2.0
"""Corpora as data sets of Ray Data: one row per recording, with its samples and its labels."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import ray.data
from ray.data.block import BlockMetadata
from ray.data.datasource import Datasource, ReadTask

from .. import _corpus_parts
from .._engine import InputError
from .._wav import samples_of
from ._tasks import require_positive, start

_ROWS_PER_BLOCK = 100


def _flat(row: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """{"listener": {"index": 3}} becomes {"listener.index": 3}."""
    flat: dict[str, Any] = {}
    for key, value in row.items():
        if isinstance(value, dict):
            flat.update(_flat(value, f"{prefix}{key}."))
        else:
            flat[prefix + key] = value
    return flat


def _table(rows: Sequence[dict[str, Any]], bytes_of: Callable[[str], bytes]) -> pa.Table:
    columns: dict[str, list[Any]] = {key: [] for row in rows for key in _flat(row)}
    audio, rates = [], []
    for row in rows:
        flat = _flat(row)
        for key, column in columns.items():
            column.append(flat.get(key))
        samples, rate_hz = samples_of(bytes_of(row["file"]), row["file"])
        audio.append(samples)
        rates.append(rate_hz)
    from ray.data.extensions import ArrowTensorArray, ArrowVariableShapedTensorArray

    same = len({samples.shape for samples in audio}) == 1
    tensors = ArrowTensorArray.from_numpy(np.stack(audio)) if same else ArrowVariableShapedTensorArray.from_numpy(audio)
    return pa.table(
        {"audio": tensors, "sample_rate_hz": pa.array(rates, pa.int64()), **{key: pa.array(values) for key, values in columns.items()}}
    )


def _blocks(rows: Sequence[dict[str, Any]], bytes_of: Callable[[str], bytes]) -> Iterable[pa.Table]:
    for begin in range(0, len(rows), _ROWS_PER_BLOCK):
        yield _table(rows[begin : begin + _ROWS_PER_BLOCK], bytes_of)


class _Folders(Datasource):  # type: ignore[misc,unused-ignore]  # Ray may be absent where types are checked
    """One read task per numbered folder of a corpus."""

    def __init__(self, name: str, folders: Sequence[int], read: Callable[[int], Iterable[pa.Table]], size_bytes: int | None) -> None:
        super().__init__()  # type: ignore[no-untyped-call,unused-ignore]
        self.name, self.folders, self.read, self.size_bytes = name, folders, read, size_bytes

    def get_name(self) -> str:
        return self.name

    def estimate_inmemory_data_size(self) -> int | None:
        return self.size_bytes

    def get_read_tasks(self, parallelism: int, per_task_row_limit: int | None = None, data_context: Any = None) -> list[ReadTask]:
        """One task for each folder, whatever `parallelism` asks for: a folder is the unit that is made."""
        metadata = BlockMetadata(num_rows=None, size_bytes=None, input_files=None, exec_stats=None)
        read = self.read
        return [
            ReadTask(lambda folder=folder: read(folder), metadata, per_task_row_limit=per_task_row_limit)  # type: ignore[misc,unused-ignore]
            for folder in self.folders
        ]


def read_corpus(folder: str | os.PathLike[str]) -> Any:
    """A corpus of ``earshot dataset`` as a ``ray.data.Dataset``.

    Columns: `audio` (float32 [channels, samples]), `sample_rate_hz`, and the keys of the manifest, with a point between the names of
    nested ones (`listener.position_m`). All nodes must see the folder. WAV files are read.

    :raises InputError: The folder has no complete corpus, or one in SOFA or FLAC.
    """
    out = Path(os.path.abspath(folder))
    if not (out / "corpus.json").exists() or not (out / "manifest.jsonl").exists():
        raise InputError(f"{folder}: has no complete corpus (manifest.jsonl); complete it with earshot dataset or earshot.ray.corpus")
    with open(out / "manifest.jsonl") as manifest:
        first = _corpus_parts.rows_of(manifest.readline())
    _require_wav(str(folder), first)
    start()
    numbers = sorted(int(path.parent.name) for path in out.glob("[0-9]*/manifest.jsonl") if path.parent.name.isdigit())

    def read(number: int) -> Iterable[pa.Table]:
        rows = _corpus_parts.rows_of((out / f"{number:05}" / "manifest.jsonl").read_text())
        return _blocks(rows, lambda name: (out / name).read_bytes())

    return ray.data.read_datasource(_Folders("EarshotCorpus", numbers, read, None), override_num_blocks=len(numbers))


def generate(
    command: str,
    arguments: Sequence[str | os.PathLike[str]],
    *,
    cpus_per_part: int = 1,
    scratch: str | None = None,
    program: str | os.PathLike[str] | None = None,
) -> Any:
    """Responses ("rir"), reverberant speech ("convolve"), sound scenes ("scenes") or panoramas ("pano") as a ``ray.data.Dataset`` whose
    read tasks make them: the rows of :func:`read_corpus` of the same command, without a corpus on disk.

    Each pass over the data set makes them again, with the same bits. Arguments and nodes are as in :func:`earshot.ray.corpus`.

    >>> earshot.ray.generate("rir", ["configs/datasets/rir.yaml"]).iter_batches(batch_size=32)            # doctest: +SKIP
    """
    require_positive("generate", cpus_per_part=cpus_per_part)
    with tempfile.TemporaryDirectory(prefix="earshot-plan-") as below:
        work = _corpus_parts.plan(command, arguments, Path(below) / "corpus", program)
    start()

    def read(number: int) -> Iterable[pa.Table]:
        files = {f"{number:05}/{name}": data for name, data in _corpus_parts.make_part(work, number, cpus_per_part, scratch).files()}
        rows = _corpus_parts.rows_of(bytes(files[f"{number:05}/manifest.jsonl"]).decode())
        _require_wav(f"generate {command}", rows[:1])
        return _blocks(rows, lambda name: bytes(files[name]))

    source = _Folders(f"Earshot {command}", work.missing, read, None)
    return ray.data.read_datasource(source, override_num_blocks=len(work.missing), num_cpus=cpus_per_part)


def _require_wav(what: str, rows: Sequence[dict[str, Any]]) -> None:
    for row in rows:
        file = str(row.get("file", ""))
        if not file.endswith(".wav"):
            raise InputError(f"{what}: has {file or 'no sound files'}; only corpora of WAV files are read (format: wav, sofa: false)")
