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


def _weights(outcome: Outcome, random: np.random.Generator) -> np.ndarray:
    """How often every utterance counts in one draw of rooms and speakers with replacement."""
    weights = np.ones(len(outcome.words))
    for groups in (outcome.rooms, outcome.speakers):
        names = np.unique(groups)
        drawn = random.choice(names, len(names))
        counts = {name: np.count_nonzero(drawn == name) for name in names}
        weights = weights * np.array([counts[name] for name in groups])
    return weights


def interval(outcome: Outcome, draws: int = 2000, seed: int = 0) -> tuple[float, float]:
    """95 % of the word error rate, over rooms and speakers."""
    random = np.random.default_rng(seed)
    mean = outcome.errors.mean(0)
    rates = []
    while len(rates) < draws:
        weights = _weights(outcome, random)
        if (weights * outcome.words).sum() > 0:
            rates.append(100 * (weights * mean).sum() / (weights * outcome.words).sum())
    return float(np.quantile(rates, 0.025)), float(np.quantile(rates, 0.975))


def paired_difference(a: Outcome, b: Outcome, draws: int = 2000, seed: int = 0) -> tuple[float, float, float]:
    """a less b in points of the word error rate, with 95 % over rooms, speakers and seeds drawn for both at once."""
    random = np.random.default_rng(seed)
    difference = a.errors.astype(float) - b.errors
    values = []
    while len(values) < draws:
        weights = _weights(a, random)
        seeds = random.integers(0, len(difference), len(difference))
        if (weights * a.words).sum() > 0:
            values.append(100 * (weights * difference[seeds].mean(0)).sum() / (weights * a.words).sum())
    return float(100 * difference.mean(0).sum() / a.words.sum()), float(np.quantile(values, 0.025)), float(np.quantile(values, 0.975))
