# SPDX-License-Identifier: Apache-2.0
"""The dataset card of an export and its Croissant metadata (http://mlcommons.org/croissant/1.0)."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ._corpus import KEYS, Corpus, grade_of

_SIZES = ((10**3, "n<1K"), (10**4, "1K<n<10K"), (10**5, "10K<n<100K"), (10**6, "100K<n<1M"), (10**7, "1M<n<10M"), (10**8, "10M<n<100M"))
_TYPES = {"text": "sc:Text", "whole": "sc:Integer", "number": "sc:Float", "numbers": "sc:Float", "flag": "sc:Boolean"}
_GRADES = (
    ("A", "at most 5 %, the just-noticeable difference (ISO 3382-1:2009, Annex A)"),
    ("B", "above 5 %, at most 10 %"),
    ("C", "above 10 %"),
    ("none", "not known, or not asked for (`stated_errors`)"),
)
_ABOUT = {
    "id": "Name of the response",
    "scene": "SCENE text of earshot rir",
    "scene_hash": "Hash of geometry and materials",
    "room": "Number of the room, from 0",
    "split_sample": "First sample of the late part",
    "distance_m": "Distance of source and listener in metres",
    "azimuth_deg": "Azimuth of the source in degrees, counter-clockwise from the front of the listener",
    "elevation_deg": "Elevation of the source in degrees, upwards",
    "line_of_sight": "Whether the straight line is free",
    "direct_delay_s": "Delay along the straight line in seconds",
    "drr_db": "Direct-to-reverberant ratio in dB",
    "t20_mid_s": "Mean T20 of the octaves at 500 Hz and 1 kHz in seconds",
    "t20_s": "T20 per band in seconds",
    "rt60_s": "RT60 per band in seconds",
    "c50_db": "C50 per band in dB",
    "t20_error_s": "Standard error of t20_s per band",
    "field_t20_error": "Relative standard error of T20 of the source field",
    "num_samples": "Length in samples",
    "gain": "Factor on the samples",
    "sample_rate_hz": "Sample rate in Hz",
    "t20_error": "Relative standard error of t20_mid_s",
    "grade": "Quality grade by t20_error: A, B or C",
}

_TEXT = """# {name}

{count} simulated room impulse responses of {rooms} rooms with labels, made by Earshot ({engine}).

| quantity | value |
|---|---|
| responses | {count} |
| rooms | {rooms} |
| channels | {channels} |
| sample rate | {rate:g} Hz |
| octave bands of the labels | {bands} Hz |

## Quality

`t20_error` is the relative standard error of the reverberation time `t20_mid_s` that the simulation states for each response. It does
not contain deviations of the models from reality. `grade` follows from it:

| grade | error | responses |
|---|---|---|
{grades}

{errors}

## Licences

The corpus: {license}. Its inputs:

| input | licence |
|---|---|
{licenses}

## Files

{files}

Pressure is in Green units: at the distance r a unit source gives 1 / (4 pi r). `gain` is the factor on the samples. Sample n is at n / rate
seconds after emission.

## Make it again

```sh
earshot dataset rir config.yaml --out corpus
```

```yaml
{config}
```

## Limitations

The responses are simulated by path tracing with image sources and diffraction. Below the Schroeder frequency of a room they lack wave
effects.
"""
_COMMON = "- `croissant.json`: Croissant metadata.\n- `export.json`: arguments of the export."
_FILES = {
    "webdataset": "- `data/*.tar`: WebDataset shards. A sample is `ID.json` (labels) and `ID.wav` or `ID.flac`; where the corpus has\n"
    "  them also `ID.early.wav`, `ID.late.wav`, `ID.rgb.png`, `ID.depth.png` and `ID.category.png`.\n"
    "- `labels.jsonl`: the labels of all samples.\n" + _COMMON,
    "parquet": "- `data/*.parquet`: a row per response. `audio`, `early`, `late`, `rgb`, `depth` and `category` hold a file as\n"
    "  `bytes` and `path`.\n" + _COMMON,
}


def card(corpus: Corpus, form: str, name: str, license_id: str, licenses: Mapping[str, str]) -> str:
    """README.md of the Hugging Face Hub."""
    errors = [corpus.t20_error(index) for index in range(len(corpus))]
    grades = Counter(grade_of(error) or "none" for error in errors)
    known = sorted(error for error in errors if error is not None)
    front = "\n".join(
        [
            "---",
            f"pretty_name: {json.dumps(name, ensure_ascii=False)}",
            f"license: {json.dumps(license_id, ensure_ascii=False)}",
            "language_creators:\n  - machine-generated",
            "annotations_creators:\n  - machine-generated",
            "source_datasets:\n  - original",
            f"size_categories:\n  - {next((size for end, size in _SIZES if len(corpus) < end), '100M<n<1B')}",
            "task_categories:\n  - audio-to-audio\n  - audio-classification",
            "tags:\n  - room-impulse-response\n  - room-acoustics\n  - simulation\n  - earshot",
            "configs:\n  - config_name: default\n    data_files:\n      - split: train",
            f"        path: data/*.{'tar' if form == 'webdataset' else form}",
            "---",
            "",
            "",
        ]
    )
    return front + _TEXT.format(
        name=name,
        count=f"{len(corpus):,}",
        rooms=f"{int(corpus.description.get('rooms', 0)):,}",
        engine=corpus.description.get("engine", "unknown program"),
        channels=", ".join(corpus.channels),
        rate=corpus.rate_hz,
        bands=", ".join(f"{hz:g}" for hz in corpus.bands_hz),
        grades="\n".join(f"| {grade} | {about} | {grades[grade]:,} |" for grade, about in _GRADES),
        errors=f"The median of the stated errors is {_percent(known[len(known) // 2])}, the largest {_percent(known[-1])}."
        if known
        else "No response states an error.",
        license=license_id,
        licenses="\n".join(f"| {_cell(text)} | {_cell(licence)} |" for text, licence in licenses.items()),
        files=_FILES[form],
        config=str(corpus.description.get("config", "")).strip(),
    )


def croissant(
    corpus: Corpus, name: str, license_id: str, licenses: Mapping[str, str], shards: list[Path], labels: Path | None
) -> dict[str, Any]:
    """JSON-LD with every shard, its hash, and the labels as fields.  labels: file of the labels; None where the shards are tables."""
    kinds = {key: kind for key, kind in KEYS.items() if kind is not None and any(key in line for line in corpus.lines)}
    kinds |= {"sample_rate_hz": "whole", "t20_error": "number", "grade": "text"}
    kind_of_shard = "application/x-tar" if labels is not None else "application/x-parquet"
    objects = [_file_object(path.name, path, f"data/{path.name}", kind_of_shard) for path in shards]
    if labels is not None:
        objects.append(_file_object("labels", labels, labels.name, "application/jsonlines"))
    else:
        objects.append(
            {
                "@type": "cr:FileSet",
                "@id": "labels",
                "name": "labels",
                "encodingFormat": "application/x-parquet",
                "includes": "data/*.parquet",
            }
        )
    origin = "fileSet" if labels is None else "fileObject"
    fields = []
    for key, kind in kinds.items():
        if kind in ("source", "listener"):
            continue
        fields.append(
            {
                "@type": "cr:Field",
                "@id": f"responses/{key}",
                "name": f"responses/{key}",
                "description": _ABOUT[key],
                "dataType": _TYPES[kind],
                **({"isArray": True, "arrayShape": "-1"} if kind == "numbers" else {}),
                "source": {origin: {"@id": "labels"}, "extract": {"column": key}},
            }
        )
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "name": name,
        "description": f"{len(corpus)} simulated room impulse responses with labels, made by Earshot.",
        "conformsTo": "http://mlcommons.org/croissant/1.1",
        "license": license_id,
        "version": "1.0.0",
        "isLiveDataset": False,
        "creator": {"@type": "sc:Organization", "name": "Earshot"},
        "citeAs": f"{name}, room impulse responses simulated by Earshot ({corpus.description.get('engine', 'unknown program')})",
        "datePublished": "1970-01-01",  # that of the export would change the bytes
        "url": ".",
        "isBasedOn": [{"@type": "sc:CreativeWork", "name": text, "license": licence} for text, licence in licenses.items()],
        "distribution": objects,
        "recordSet": [
            {
                "@type": "cr:RecordSet",
                "@id": "responses",
                "name": "responses",
                "description": "Labels of each response.",
                "key": {"@id": "responses/id"},
                "field": fields,
            }
        ],
    }


def _file_object(name: str, path: Path, url: str, encoding: str) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": name,
        "name": name,
        "contentUrl": url,
        "contentSize": f"{path.stat().st_size} B",
        "encodingFormat": encoding,
        "sha256": _sha256(path),
    }


def _sha256(path: Path) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _percent(ratio: float) -> str:
    return f"{100 * ratio:.2g} %"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


#: The context that the format prescribes.
_CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "arrayShape": "cr:arrayShape",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileProperty": "cr:fileProperty",
    "fileObject": "cr:fileObject",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isArray": "cr:isArray",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
