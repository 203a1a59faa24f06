# SPDX-License-Identifier: Apache-2.0
"""Shards of a corpus: WebDataset (tar) and Parquet, with a dataset card and Croissant metadata."""

from __future__ import annotations

import io
import json
import os
import tarfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from .._engine import InputError, __version__
from ..integrations._common import require
from . import _card
from ._corpus import KEYS, Corpus, grade_of
from ._files import begin, write_text, write_whole

_FILES = [key for key, kind in KEYS.items() if kind is None]
_EXTENSIONS = {
    "file": "",
    "early_file": "early.",
    "late_file": "late.",
    "rgb_file": "rgb.",
    "depth_file": "depth.",
    "category_file": "category.",
}
_GENERATED_LICENSE = "Apache-2.0"
_ROWS_PER_GROUP = 100

PathLike = str | os.PathLike[str]
Progress = Callable[[int, int], None]  #: shards done and in all


def write_webdataset(
    folder: PathLike,
    out: PathLike,
    *,
    license_id: str,
    name: str = "",
    input_licenses: Mapping[str, str] | None = None,
    responses_per_shard: int = 1000,
    progress: Progress | None = None,
) -> list[Path]:
    """Copy a corpus into WebDataset shards: for each response ``ID.json`` with the labels, ``ID.wav``, and its pictures and parts.

    The call can be repeated after an interruption; shards that are there stay.  Bytes are a function of the corpus and the arguments.

    :param folder: What ``earshot dataset rir`` or ``dataset pano`` wrote as ``--out``.
    :param license_id: Licence of the corpus, such as "cc-by-4.0".
    :param name: Name on the card; the default is that of the folder.
    :param input_licenses: Licence of each file that the corpus was made from, by its name or the beginning of its name.
    :param progress: Called after each shard.
    :returns: Paths of the shards.
    :raises InputError: No complete corpus, an input without a licence, or other files in ``out``.
    :raises RunError: A file cannot be written.
    """
    export = _Export(folder, out, "webdataset", license_id, name, input_licenses, responses_per_shard)
    return export.run(lambda file, rows: _write_tar(file, export.corpus, rows), "tar", progress)


def write_parquet(
    folder: PathLike,
    out: PathLike,
    *,
    license_id: str,
    name: str = "",
    input_licenses: Mapping[str, str] | None = None,
    responses_per_shard: int = 1000,
    progress: Progress | None = None,
) -> list[Path]:
    """The same as Parquet (extra ``data``): a row per response, sound files and pictures as their bytes with a name.

    ``datasets.load_dataset`` reads the folder.  Bytes also depend on the version of pyarrow, which ``export.json`` records.
    """
    arrow = require("pyarrow", "data")
    export = _Export(folder, out, "parquet", license_id, name, input_licenses, responses_per_shard, {"pyarrow": arrow.__version__})
    return export.run(lambda file, rows: _write_table(file, export.corpus, rows), "parquet", progress)


class _Export:
    def __init__(
        self,
        folder: PathLike,
        out: PathLike,
        form: str,
        license_id: str,
        name: str,
        input_licenses: Mapping[str, str] | None,
        responses_per_shard: int,
        versions: Mapping[str, str] | None = None,
    ) -> None:
        if not license_id.strip() or any(ch.isspace() for ch in license_id):
            raise InputError(f"license is {license_id!r}; give the identifier of a licence, such as cc-by-4.0")
        if not 1 <= responses_per_shard <= 10**6:
            raise InputError(f"responses_per_shard is {responses_per_shard}; give a number from 1 to 1,000,000")
        self.corpus = Corpus(folder)
        self.out = Path(out)
        inside = self.out.resolve()
        if inside == self.corpus.folder.resolve() or self.corpus.folder.resolve() in inside.parents:
            raise InputError(f"{self.out}: lies in the corpus itself; give a folder outside of it")
        self.form = form
        self.name = name.strip() or self.corpus.folder.resolve().name
        if any(ord(ch) < 32 for ch in self.name):
            raise InputError(f"name is {self.name!r}; give a name without control characters")
        self.license_id = license_id
        self.licenses = _licenses_of(self.corpus, input_licenses or {})
        self.per_shard = responses_per_shard
        begin(
            self.out,
            {
                "format": form,
                "corpus_sha256": self.corpus.hash,
                "name": self.name,
                "license": license_id,
                "input_licenses": self.licenses,
                "responses_per_shard": responses_per_shard,
                "earshot": __version__,
                **(versions or {}),
            },
        )

    def run(self, write: Callable[[BinaryIO, range], None], extension: str, progress: Progress | None) -> list[Path]:
        shards = -(-len(self.corpus) // self.per_shard)
        folder = self.out / "data"
        folder.mkdir(exist_ok=True)
        paths = [folder / f"train-{shard:05}-of-{shards:05}.{extension}" for shard in range(shards)]
        for leftover in folder.glob(".*.part"):
            leftover.unlink(missing_ok=True)
        for shard, path in enumerate(paths):
            rows = range(shard * self.per_shard, min(len(self.corpus), (shard + 1) * self.per_shard))
            if not path.exists():
                write_whole(path, lambda file, rows=rows: write(file, rows))  # type: ignore[misc]
            if progress is not None:
                progress(shard + 1, shards)
        if not (self.out / "README.md").exists():
            labels = None
            if self.form == "webdataset":
                labels = self.out / "labels.jsonl"
                write_text(labels, "".join(_label_line(self.corpus, index) for index in range(len(self.corpus))))
            croissant = _card.croissant(self.corpus, self.name, self.license_id, self.licenses, paths, labels)
            write_text(self.out / "croissant.json", json.dumps(croissant, indent=1, ensure_ascii=False) + "\n")
            # Last: its presence marks a complete export.
            write_text(self.out / "README.md", _card.card(self.corpus, self.form, self.name, self.license_id, self.licenses))
        return paths


def _licenses_of(corpus: Corpus, given: Mapping[str, str]) -> dict[str, str]:
    """By name of the input, the generated ones first."""
    licenses = {"rooms, houses, materials and heads that Earshot generates": _GENERATED_LICENSE}
    used = set()
    for name in corpus.inputs():
        best = max((key for key in given if key and name.startswith(key)), key=len, default=None)
        if best is None:
            raise InputError(f"{name}: has no stated licence; give --input-license '{name}=LICENCE'")
        used.add(best)
        licenses[name] = given[best]
    unused = next((key for key in given if key not in used), None)
    if unused is not None:
        raise InputError(
            f"input licence {unused!r}: names no input of {corpus.folder}; its inputs are: {', '.join(corpus.inputs()) or 'none'}"
        )
    return licenses


def labels_of(corpus: Corpus, index: int) -> dict[str, Any]:
    """The line without paths, with the stated error and the grade."""
    line = corpus.lines[index]
    labels = {key: value for key, value in line.items() if key in KEYS and KEYS[key] is not None}
    error = corpus.t20_error(index)
    return {**labels, "sample_rate_hz": round(corpus.rate_hz), "t20_error": error, "grade": grade_of(error)}


def _label_line(corpus: Corpus, index: int) -> str:
    return json.dumps(labels_of(corpus, index), ensure_ascii=False) + "\n"


def _write_tar(file: BinaryIO, corpus: Corpus, rows: range) -> None:
    with tarfile.open(fileobj=file, mode="w", format=tarfile.USTAR_FORMAT) as tar:
        for index in rows:
            line = corpus.lines[index]
            key = str(line["id"])
            if not key or not all(ch.isalnum() or ch in "_-" for ch in key):
                raise InputError(f"{corpus.folder}: has the id {key!r}, which cannot be a name of a sample; write the corpus again")
            _add(tar, f"{key}.json", _label_line(corpus, index).encode())
            for part in _FILES:
                if line.get(part):
                    path = str(line[part])
                    _add(tar, f"{key}.{_EXTENSIONS[part]}{path.rsplit('.', 1)[-1]}", corpus.file(path))


def _add(tar: tarfile.TarFile, name: str, data: bytes) -> None:
    entry = tarfile.TarInfo(name)  # time 0, owner 0, mode 0644: the same bytes at any time
    entry.size = len(data)
    tar.addfile(entry, io.BytesIO(data))


def columns_of(corpus: Corpus) -> dict[str, str]:
    """Columns of the table with their kinds, in order: those that some response has."""
    columns: dict[str, str] = {}
    for key, kind in KEYS.items():
        if not any(key in line for line in corpus.lines):
            continue
        if kind is None:
            columns["audio" if key == "file" else key.removesuffix("_file")] = "image" if key in _FILES[3:] else "audio"
        else:
            columns[key] = kind
    return {**columns, "sample_rate_hz": "whole", "t20_error": "number", "grade": "text"}


def _schema(corpus: Corpus) -> Any:
    arrow = require("pyarrow", "data")
    place = arrow.struct([("index", arrow.int64()), ("position_m", arrow.list_(arrow.float64())), ("heading_deg", arrow.float64())])
    stored = arrow.struct([("bytes", arrow.binary()), ("path", arrow.string())])
    types = {
        "text": arrow.string(),
        "whole": arrow.int64(),
        "number": arrow.float64(),
        "numbers": arrow.list_(arrow.float64()),
        "flag": arrow.bool_(),
        "source": arrow.struct([*place, ("pattern", arrow.string())]),
        "listener": arrow.struct([*place, ("pitch_deg", arrow.float64()), ("roll_deg", arrow.float64()), ("hrtf", arrow.string())]),
        "audio": stored,
        "image": stored,
    }
    columns = columns_of(corpus)
    # Which columns `datasets` decodes.
    features = {
        column: _feature(kind, [field.name for field in types[kind]] if kind in ("source", "listener") else [])
        for column, kind in columns.items()
    }
    metadata = {"huggingface": json.dumps({"info": {"features": features}})}
    return arrow.schema([(column, types[kind]) for column, kind in columns.items()], metadata=metadata)


def _feature(kind: str, fields: list[str]) -> Any:
    numbers = {"dtype": "float64", "_type": "Value"}
    simple = {"text": "string", "whole": "int64", "number": "float64", "flag": "bool"}
    if kind in simple:
        return {"dtype": simple[kind], "_type": "Value"}
    if kind == "numbers":
        return {"feature": numbers, "_type": "List"}
    if kind in ("audio", "image"):
        return {"_type": kind.capitalize()}
    of_field = {"index": "whole", "position_m": "numbers", "pattern": "text", "hrtf": "text"}
    return {field: _feature(of_field.get(field, "number"), []) for field in fields}


def _write_table(file: BinaryIO, corpus: Corpus, rows: range) -> None:
    arrow, parquet = require("pyarrow", "data"), require("pyarrow.parquet", "data")
    schema = _schema(corpus)
    with parquet.ParquetWriter(file, schema, compression="zstd", write_statistics=False) as writer:
        for first in range(rows.start, rows.stop, _ROWS_PER_GROUP):
            group = [_row(corpus, index) for index in range(first, min(rows.stop, first + _ROWS_PER_GROUP))]
            writer.write_table(arrow.Table.from_pylist(group, schema=schema))


def _row(corpus: Corpus, index: int) -> dict[str, Any]:
    line = corpus.lines[index]
    row = labels_of(corpus, index)
    for part in _FILES:
        if line.get(part):
            path = str(line[part])
            row["audio" if part == "file" else part.removesuffix("_file")] = {"bytes": corpus.file(path), "path": Path(path).name}
    return row
