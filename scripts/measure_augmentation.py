#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""measure_augmentation.py CORPUS [WORKERS]: augmented utterances per second of processor time, for each start method of a DataLoader.

Utterances of 4 s at the rate of the corpus, white noise, cut at the end of the speech.  Counts the processor time (user and system) of this
process and of its workers over a pass, without their start.  Needs torch and the extra [data].
"""

from __future__ import annotations

import os
import sys
import time

import numpy as np
import torch
from torch.utils.data import DataLoader

from earshot.data import Augment, CorpusResponses
from earshot.data.torch import AugmentedSpeech

COUNT = 1000
SECONDS = 4


class Repeated:
    """COUNT utterances of noise, of which 16 differ."""

    def __init__(self, rate_hz: float) -> None:
        draw = np.random.default_rng(1)
        self.sounds = [0.1 * draw.standard_normal(round(SECONDS * rate_hz)).astype(np.float32) for _ in range(16)]

    def __len__(self) -> int:
        return COUNT

    def __getitem__(self, index: int) -> np.ndarray:
        return self.sounds[index % len(self.sounds)]


def processor_s(pids: list[int]) -> float:
    ticks = 0
    for pid in pids:
        with open(f"/proc/{pid}/stat") as file:
            ticks += sum(int(field) for field in file.read().rpartition(")")[2].split()[11:13])
    return ticks / os.sysconf("SC_CLK_TCK")


def measure(dataset: AugmentedSpeech, method: str | None, workers: int) -> tuple[float, float]:
    keys = {"multiprocessing_context": method, "persistent_workers": True, "num_workers": workers} if method else {}
    loader = DataLoader(dataset, batch_size=16, **keys)
    for _ in loader:  # starts the workers
        pass
    dataset.set_epoch(1)
    iterator = iter(loader)
    pids = [os.getpid(), *(worker.pid for worker in getattr(iterator, "_workers", []))]
    before, begin = processor_s(pids), time.monotonic()
    for _ in iterator:
        pass
    return COUNT / (processor_s(pids) - before), COUNT / (time.monotonic() - begin)


def main() -> None:
    torch.set_num_threads(1)
    responses = CorpusResponses(sys.argv[1])
    workers = int(sys.argv[2]) if len(sys.argv) > 2 else 2
    dataset = AugmentedSpeech(Augment(responses, noise="white", cut=True), Repeated(responses.rate_hz))
    print(f"{len(responses)} responses {responses[0].shape}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.0f}")
    for method, count in ((None, 0), ("fork", workers), ("forkserver", workers), ("spawn", workers)):
        per_core, per_second = measure(dataset, method, count)
        print(f"{method or 'no worker':10} {count} workers: {per_core:6.0f} per second and core, {per_second:6.0f} per second", flush=True)


if __name__ == "__main__":
    main()
