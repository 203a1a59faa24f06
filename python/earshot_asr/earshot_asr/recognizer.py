# SPDX-License-Identifier: Apache-2.0
"""A small recognizer: log-mel frames, convolutions, a recurrent layer in both directions, CTC (Graves et al. 2006)."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import torch

from .speech import RATE_HZ

FRAME, HOP, MELS = 256, 80, 40  # 32 ms every 10 ms at 8 kHz


def mel_filters() -> torch.Tensor:
    def mel(hz: np.ndarray) -> np.ndarray:
        return 2595 * np.log10(1 + hz / 700)

    bins = mel(np.linspace(0, RATE_HZ / 2, FRAME // 2 + 1))
    edges = np.linspace(mel(np.array(60.0)), mel(np.array(RATE_HZ / 2)), MELS + 2)
    rising = (bins[None] - edges[:-2, None]) / (edges[1:-1] - edges[:-2])[:, None]
    falling = (edges[2:, None] - bins[None]) / (edges[2:] - edges[1:-1])[:, None]
    return torch.tensor(np.clip(np.minimum(rising, falling), 0, None), dtype=torch.float32)


class Features:
    """Log-mel energies [batch, MELS, frame], each band with zero mean and unit spread over the utterance."""

    def __init__(self) -> None:
        self.filters, self.window = mel_filters(), torch.hann_window(FRAME)

    def __call__(self, batch: list[np.ndarray]) -> tuple[torch.Tensor, torch.Tensor]:
        longest = max(len(samples) for samples in batch)
        padded = torch.zeros(len(batch), longest)
        for i, samples in enumerate(batch):
            padded[i, : len(samples)] = torch.from_numpy(samples)
        spectrum = torch.stft(padded, FRAME, HOP, window=self.window, center=True, return_complex=True)
        power = torch.view_as_real(spectrum).square().sum(3)
        levels = torch.log(torch.matmul(self.filters, power) + 1e-6)
        frames = torch.tensor([1 + len(samples) // HOP for samples in batch])
        inside = (torch.arange(levels.shape[2])[None] < frames[:, None])[:, None].float()
        mean = (levels * inside).sum(2, keepdim=True) / frames[:, None, None]
        spread = torch.sqrt((((levels - mean) * inside) ** 2).sum(2, keepdim=True) / frames[:, None, None])
        return (levels - mean) * inside / (spread + 1e-3), frames


@dataclasses.dataclass(frozen=True)
class Prepared:
    """Features of utterances that are recognized more than once: batches of neighbours in length, with their places in the list."""

    count: int
    batches: list[tuple[list[int], torch.Tensor, torch.Tensor]]


def prepared(utterances: Sequence[np.ndarray], batch: int = 64) -> Prepared:
    features, order = Features(), sorted(range(len(utterances)), key=lambda i: len(utterances[i]))
    parts = [order[first : first + batch] for first in range(0, len(order), batch)]
    return Prepared(len(order), [(part, *features([utterances[i] for i in part])) for part in parts])


class Network(torch.nn.Module):
    """Log-probabilities [frame, batch, token + 1]; the last one is the blank.  One output frame is 40 ms."""

    def __init__(self, tokens: int, width: int = 96) -> None:
        super().__init__()
        self.convolutions = torch.nn.Sequential(
            torch.nn.Conv1d(MELS, width, 5, stride=2, padding=2),
            torch.nn.ReLU(),
            torch.nn.Conv1d(width, width, 5, stride=2, padding=2),
            torch.nn.ReLU(),
        )
        self.recurrent = torch.nn.GRU(width, width, batch_first=True, bidirectional=True)
        self.out = torch.nn.Linear(2 * width, tokens + 1)

    @staticmethod
    def frames(features: torch.Tensor) -> torch.Tensor:
        """Output frames of so many frames of features."""
        return (features + 3) // 4

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        hidden = self.convolutions(features).transpose(1, 2)
        return torch.log_softmax(self.out(self.recurrent(hidden)[0]), dim=2).transpose(0, 1)


class Recognizer:
    def __init__(self, tokens: int, seed: int) -> None:
        torch.manual_seed(seed)
        self.tokens, self.features, self.network = tokens, Features(), Network(tokens)

    def copy(self) -> Recognizer:
        other = Recognizer(self.tokens, 0)
        other.network.load_state_dict(copy.deepcopy(self.network.state_dict()))
        return other

    def train(
        self,
        draw: Callable[[np.random.Generator], tuple[np.ndarray, tuple[int, ...]]],
        steps: int,
        seed: int,
        rate: float = 2e-3,
        batch: int = 32,
        progress: Callable[[int, float], None] | None = None,
    ) -> None:
        """`draw`: one utterance with its tokens."""
        batches = batches_of(draw, np.random.default_rng(seed), batch)
        optimizer = torch.optim.Adam(self.network.parameters(), rate)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, rate, total_steps=max(steps, 11), pct_start=0.1)
        loss_of = torch.nn.CTCLoss(blank=self.tokens, zero_infinity=True)
        self.network.train()
        for step in range(steps):
            drawn = next(batches)
            features, frames = self.features([samples for samples, _ in drawn])
            targets = torch.tensor([token for _, tokens in drawn for token in tokens])
            lengths = torch.tensor([len(tokens) for _, tokens in drawn])
            loss = loss_of(self.network(features), targets, self.network.frames(frames), lengths)
            optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
            optimizer.step()
            schedule.step()
            if progress:
                progress(step + 1, float(loss))

    @torch.no_grad()
    def recognize(self, utterances: Sequence[np.ndarray] | Prepared) -> list[tuple[int, ...]]:
        """The likeliest token of every frame, repeats and blanks left out."""
        if not isinstance(utterances, Prepared):
            utterances = prepared(utterances)
        self.network.eval()
        found: list[tuple[int, ...]] = [()] * utterances.count
        for places, features, frames in utterances.batches:
            best = self.network(features).argmax(2).transpose(0, 1)
            for place, row, length in zip(places, best, self.network.frames(frames), strict=True):
                kept = torch.unique_consecutive(row[:length]).tolist()
                found[place] = tuple(token for token in kept if token != self.tokens)
        return found


def batches_of(
    draw: Callable[[np.random.Generator], tuple[np.ndarray, tuple[int, ...]]], random: np.random.Generator, batch: int
) -> Iterator[list[tuple[np.ndarray, tuple[int, ...]]]]:
    """Without end.  Four batches are drawn at once and parted by length, so that little is padded; they come in random order."""
    while True:
        drawn = sorted((draw(random) for _ in range(4 * batch)), key=lambda pair: len(pair[0]))
        for part in random.permutation(4):
            yield drawn[part * batch : (part + 1) * batch]
