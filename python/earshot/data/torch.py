# SPDX-License-Identifier: Apache-2.0
"""Augmented speech for ``torch.utils.data.DataLoader``, with worker processes of any start method (needs PyTorch).

    dataset = AugmentedSpeech(augment, utterances)
    loader = DataLoader(dataset, batch_size=None, num_workers=8, multiprocessing_context="spawn", persistent_workers=True)
    for epoch in range(10):
        dataset.set_epoch(epoch)
        for item in loader: ...

Items are dicts: ``signal`` float32 [channels, samples], ``index``, and the labels of :class:`earshot.data.Augmented`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import torch
from torch.utils.data import Dataset, IterableDataset, get_worker_info

from .._engine import InputError
from ._augment import Augment


class AugmentedSpeech(Dataset[dict[str, Any]]):
    """Utterance ``i`` of a list, augmented by the numbers of (epoch, i).

    :param speech: Utterances [samples] at the rate of the responses: a list of arrays, or any sequence that reads them.
    """

    def __init__(self, augment: Augment, speech: Sequence[Any]) -> None:
        if not len(speech):
            raise InputError("AugmentedSpeech: speech is empty; give at least one utterance")
        self.augment = augment
        self.speech = speech
        # In shared memory: workers that live on see the epoch as well.
        self._epoch = torch.zeros((), dtype=torch.int64).share_memory_()

    def set_epoch(self, epoch: int) -> None:
        """Draw anew from the next pass on.  Call it between passes."""
        if not 0 <= epoch < 2**63:
            raise InputError(f"epoch is {epoch}; give a whole number from 0 on")
        self._epoch.fill_(epoch)

    def __len__(self) -> int:
        return len(self.speech)

    def __getitem__(self, index: int) -> dict[str, Any]:
        made = self.augment(self.speech[index], epoch=int(self._epoch), index=index)
        return {**made.labels, "index": index, "signal": torch.from_numpy(made.signal)}


class AugmentedStream(IterableDataset[dict[str, Any]]):
    """The same as a stream.  Each worker makes whole batches in turn, so the order of a loader does not depend on their number.

    :param batch_size: That of the ``DataLoader``; 1 for ``batch_size=None``.
    :param rank: Process of a group of ``world`` processes; each takes every ``world``-th utterance.
    """

    def __init__(self, augment: Augment, speech: Sequence[Any], *, batch_size: int = 1, rank: int = 0, world: int = 1) -> None:
        if not 0 <= rank < world:
            raise InputError(f"AugmentedStream: rank is {rank} of {world}; give a rank from 0 to world - 1")
        if batch_size < 1:
            raise InputError(f"AugmentedStream: batch_size is {batch_size}; give at least 1")
        self._items = AugmentedSpeech(augment, speech)
        self._mine = range(rank, len(speech), world)
        self._batch_size = batch_size

    def set_epoch(self, epoch: int) -> None:
        """As :meth:`AugmentedSpeech.set_epoch`."""
        self._items.set_epoch(epoch)

    def __len__(self) -> int:
        return len(self._mine)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        worker = get_worker_info()
        first, workers = (0, 1) if worker is None else (worker.id, worker.num_workers)
        for begin in range(first * self._batch_size, len(self._mine), workers * self._batch_size):
            for index in self._mine[begin : begin + self._batch_size]:
                yield self._items[index]
