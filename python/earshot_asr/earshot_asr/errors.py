# SPDX-License-Identifier: Apache-2.0
"""Word errors, and what a difference between two recognizers is worth."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np


def word_errors(said: Sequence[object], heard: Sequence[object]) -> int:
    """Least number of words to change, leave out and add."""
    row = list(range(len(heard) + 1))
    for i, word in enumerate(said, 1):
        before, row[0] = row[0], i
        for j, other in enumerate(heard, 1):
            before, row[j] = row[j], min(before + (word != other), row[j] + 1, row[j - 1] + 1)
    return row[-1]


@dataclasses.dataclass(frozen=True)
class Outcome:
    """Errors of every test utterance; several recognizers have the same utterances in the same order."""

    errors: np.ndarray  # [seed, utterance]
    words: np.ndarray  # [utterance]
    rooms: np.ndarray  # [utterance], a number for each room
    speakers: np.ndarray

    def rate(self) -> float:
        """Percent of the words, over all seeds."""
        return float(100 * self.errors.mean(0).sum() / self.words.sum())


def _weights(outcome: Outcome, draws: int, random: np.random.Generator) -> np.ndarray:
    """How often every utterance counts in draws of rooms and speakers with replacement, [draw, utterance]; each draw has words."""
    kept: list[np.ndarray] = []
    while sum(map(len, kept)) < draws:
        weights = np.ones((draws, len(outcome.words)))
        for groups in (outcome.rooms, outcome.speakers):
            names, place = np.unique(groups, return_inverse=True)
            counts = random.multinomial(len(names), np.full(len(names), 1 / len(names)), draws)
            weights *= counts[:, place]
        kept.append(weights[weights @ outcome.words > 0])
    return np.concatenate(kept)[:draws]


def interval(outcome: Outcome, draws: int = 2000, seed: int = 0) -> tuple[float, float]:
    """95 % of the word error rate, over rooms and speakers."""
    weights = _weights(outcome, draws, np.random.default_rng(seed))
    rates = 100 * (weights @ outcome.errors.mean(0)) / (weights @ outcome.words)
    return float(np.quantile(rates, 0.025)), float(np.quantile(rates, 0.975))


def paired_difference(a: Outcome, b: Outcome, draws: int = 2000, seed: int = 0) -> tuple[float, float, float]:
    """a less b in points of the word error rate, with 95 % over rooms, speakers and seeds drawn for both at once."""
    random = np.random.default_rng(seed)
    difference = a.errors.astype(float) - b.errors
    weights = _weights(a, draws, random)
    seeds = random.multinomial(len(difference), np.full(len(difference), 1 / len(difference)), draws) / len(difference)
    values = 100 * np.sum(weights * (seeds @ difference), axis=1) / (weights @ a.words)
    return float(100 * difference.mean(0).sum() / a.words.sum()), float(np.quantile(values, 0.025)), float(np.quantile(values, 0.975))
