# SPDX-License-Identifier: Apache-2.0
"""What the commands share: runs of the program, intervals, progress, files."""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys
import time
from collections.abc import Sequence

import numpy as np

from .speech import DataError


def run_program(program: str, *arguments: object) -> None:
    """DataError with the last line of its errors if it fails."""
    command = [program, *(str(argument) for argument in arguments)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or [f"ended with {done.returncode}"])[-1]
        raise DataError(f"{' '.join(command[:3])}: {last}")


def write_atomically(path: pathlib.Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(path.suffix + f".part{os.getpid()}")
    part.write_bytes(data)
    part.replace(path)


def settings(*keys: str) -> list[str]:
    """--set KEY=VALUE of each."""
    return [part for key in keys for part in ("--set", key)]


def bootstrap(
    values: np.ndarray, groups: Sequence[np.ndarray], statistic: str = "mean", draws: int = 2000, seed: int = 0
) -> tuple[float, float, float]:
    """Mean or median of `values` [n] and its 95 % interval, with every grouping [n] drawn with replacement at once."""
    random = np.random.default_rng(seed)
    inverse = [np.unique(group, return_inverse=True)[1] for group in groups]
    order = np.argsort(values)
    found = []
    while len(found) < draws:
        weights = np.ones(len(values))
        for of_value in inverse:
            count = int(of_value.max()) + 1
            weights = weights * np.bincount(random.integers(0, count, count), minlength=count)[of_value]
        if weights.sum() == 0:
            continue
        if statistic == "median":
            reached = np.cumsum(weights[order])
            found.append(values[order][np.searchsorted(reached, reached[-1] / 2)])
        else:
            found.append(np.average(values, weights=weights))
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


def refuse_what_is_no_folder(data: pathlib.Path | None) -> None:
    if data is not None and not data.is_dir():
        raise DataError(f"{data}: no such folder")
