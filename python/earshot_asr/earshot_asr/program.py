# SPDX-License-Identifier: Apache-2.0
"""What the commands share: runs of the program, intervals, progress, files."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import importlib.metadata
import importlib.util
import json
import os
import pathlib
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence

import numpy as np
import soundfile
import yaml

from .speech import RATE_HZ, Clip, DataError


def run_program(program: str, *arguments: object) -> None:
    """DataError with the last line of its errors if it fails."""
    command = [program, *(str(argument) for argument in arguments)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or [f"ended with {done.returncode}"])[-1]
        raise DataError(f"{' '.join(command[:3])}: {last}")


@functools.cache
def program_digest(program: str) -> str:
    """Of the file itself: two builds of one version differ.  Read once in a process."""
    with pathlib.Path(shutil.which(program) or program).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def package_version(name: str) -> str:
    """Empty where it is not installed."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""


def digest(*parts: object) -> str:
    """Twelve hexadecimal digits that depend on all of the parts: numbers, texts, bytes, arrays, dataclasses, and lists, tuples and dicts
    of these."""
    found = hashlib.sha256()

    def add(part: object) -> None:
        if dataclasses.is_dataclass(part) and not isinstance(part, type):
            part = {field.name: getattr(part, field.name) for field in dataclasses.fields(part)}
        if isinstance(part, dict):
            part = list(part.items())
        if isinstance(part, (list, tuple)):
            found.update(f"{len(part)} of ".encode())
            for inner in part:
                add(inner)
            return
        data = part if isinstance(part, bytes) else part.tobytes() if isinstance(part, np.ndarray) else repr(part).encode()
        about = f"{part.dtype} {part.shape}" if isinstance(part, np.ndarray) else type(part).__name__
        found.update(f"{about} {len(data)} ".encode() + data)

    add(parts)
    return found.hexdigest()[:12]


def kept_speech(clips: list[Clip], folder: pathlib.Path) -> pathlib.Path:
    """A folder of WAV files below `folder`, named after all samples: other speech has another one."""
    made = folder / f"speech_{digest([clip.samples for clip in clips], RATE_HZ)}"
    made.mkdir(parents=True, exist_ok=True)
    for i, clip in enumerate(clips):
        wav = made / f"{i:05}.wav"
        if not wav.exists():
            part = wav.with_suffix(".part")
            soundfile.write(part, clip.samples, RATE_HZ, subtype="FLOAT", format="WAV")
            part.replace(wav)
    return made


def write_atomically(path: pathlib.Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(path.suffix + f".part{os.getpid()}")
    part.write_bytes(data)
    part.replace(path)


def write_result(folder: pathlib.Path, name: str, result: dict[str, object], text: str) -> None:
    """NAME.json and NAME.md."""
    write_atomically(folder / f"{name}.json", json.dumps(result, indent=1).encode())
    write_atomically(folder / f"{name}.md", text.encode())


def settings(*keys: str) -> list[str]:
    """--set KEY=VALUE of each."""
    return [part for key in keys for part in ("--set", key)]


def weighted_median(values: np.ndarray, weights: np.ndarray) -> float:
    order = np.argsort(values)
    reached = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(reached, reached[-1] / 2)])


def bootstrap(
    values: np.ndarray, groups: Sequence[np.ndarray], statistic: str = "mean", draws: int = 2000, seed: int = 0
) -> tuple[float, float, float]:
    """`mean`, `median` or `scatter` (median distance from the median) of `values` [n] and its 95 % interval, with every grouping [n] drawn
    with replacement at once."""
    random = np.random.default_rng(seed)
    inverse = [np.unique(group, return_inverse=True)[1] for group in groups]
    found: list[float] = []
    while len(found) < draws:
        weights = np.ones(len(values))
        for of_value in inverse:
            count = int(of_value.max()) + 1
            weights = weights * np.bincount(random.integers(0, count, count), minlength=count)[of_value]
        if weights.sum() == 0:
            continue
        if statistic == "median":
            found.append(weighted_median(values, weights))
        elif statistic == "scatter":
            found.append(weighted_median(np.abs(values - weighted_median(values, weights)), weights))
        else:
            found.append(float(np.average(values, weights=weights)))
    if statistic == "scatter":
        values, statistic = np.abs(values - np.median(values)), "median"
    centre = np.median(values) if statistic == "median" else np.mean(values)
    return float(centre), float(np.quantile(found, 0.025)), float(np.quantile(found, 0.975))


def interval_text(value: Sequence[float], digits: int = 2, signed: bool = False) -> str:
    sign = "+" if signed else ""
    middle, low, high = (f"{v:{sign}.{digits}f}" for v in value)
    return f"{middle} [{low}, {high}]"


class Steps:
    """What is done, one line each on stderr, with the minutes so far."""

    def __init__(self, name: str) -> None:
        self.name, self.begin = name, time.monotonic()

    def minutes(self) -> float:
        return (time.monotonic() - self.begin) / 60

    def say(self, text: str) -> None:
        print(f"{self.name}: {self.minutes():.1f} min  {text}", file=sys.stderr, flush=True)


class Progress:
    """One line of what is done and the time to go, on stderr."""

    def __init__(self, name: str, total: int) -> None:
        self.name, self.total, self.done, self.start = name, total, 0, time.monotonic()

    def step(self, text: str = "") -> None:
        self.done += 1
        spent = time.monotonic() - self.start
        left = spent / self.done * (self.total - self.done)
        text = f"{self.name}: {self.done}/{self.total}  {text}{'  ' if text else ''}{spent / 60:.1f} min, {left / 60:.1f} min to go"
        print(text, file=sys.stderr, flush=True)


def require(*modules: str) -> None:
    """ImportError with the name of one that is missing, before anything is done."""
    for module in modules:
        if importlib.util.find_spec(module) is None:
            raise ModuleNotFoundError(f"No module named '{module}'", name=module)


def read_yaml(path: pathlib.Path) -> dict[str, object]:
    try:
        found = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: is no YAML: {one_line(error)}") from error
    if not isinstance(found, dict):
        raise DataError(f"{path}: must hold keys with values")
    return found


def read_json(path: pathlib.Path) -> object:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise DataError(f"{path}: is no JSON: {one_line(error)}") from error


def one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def refuse_what_is_no_folder(data: pathlib.Path | None) -> None:
    if data is not None and not data.is_dir():
        raise DataError(f"{data}: no such folder")
