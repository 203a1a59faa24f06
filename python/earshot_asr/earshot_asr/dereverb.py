# SPDX-License-Identifier: Apache-2.0
"""Dereverberation in small: a mask network learns the early part of reverberant speech, and is tested in measured rooms."""

from __future__ import annotations

import argparse
import dataclasses
import json
import pathlib
from collections.abc import Callable

import numpy as np
import torch

from . import responses as rooms
from .program import (
    Steps,
    bootstrap,
    digest,
    interval_text,
    kept_speech,
    program_digest,
    refuse_what_is_no_folder,
    require,
    run_program,
    settings,
    write_result,
)
from .responses import Response, onset
from .speech import DIGITS, RATE_HZ, Clip, DataError, Speech, read, recorded_digits, resample, synthesized_words, utterance

EARLY_S = 0.05  # after the direct sound
FRAME, HOP = 512, 256  # 64 ms every 32 ms
WIDTH = 96
ROWS = ("earshot", "shoebox", "measured")
SOURCES, LISTENERS = 3, 5  # of each room

Pair = tuple[np.ndarray, np.ndarray]  # reverberant, early


def early_part(response: np.ndarray) -> np.ndarray:
    part = response.copy()
    part[onset(response) + round(EARLY_S * RATE_HZ) :] = 0
    return part


def convolved(samples: np.ndarray, response: np.ndarray) -> np.ndarray:
    """As long as the speech."""
    size = len(samples) + len(response) - 1
    return np.fft.irfft(np.fft.rfft(samples, size) * np.fft.rfft(response, size), size)[: len(samples)].astype(np.float32)


def pair_of(samples: np.ndarray, response: np.ndarray) -> Pair:
    return convolved(samples, response), convolved(samples, early_part(response))


def si_sdr_db(estimate: np.ndarray, target: np.ndarray) -> float:
    """Scale-invariant ratio of target to distortion (Le Roux et al. 2019)."""
    wanted = target * (np.dot(estimate, target) / max(float(np.dot(target, target)), 1e-12))
    return float(10 * np.log10(max(float(np.sum(wanted**2)), 1e-12) / max(float(np.sum((estimate - wanted) ** 2)), 1e-12)))


class MaskNetwork(torch.nn.Module):
    """Two recurrent layers in both directions over log magnitudes; a mask of 0 to 1 for every frame and frequency."""

    def __init__(self) -> None:
        super().__init__()
        bins = FRAME // 2 + 1
        self.recurrent = torch.nn.GRU(bins, WIDTH, num_layers=2, batch_first=True, bidirectional=True)
        self.out = torch.nn.Linear(2 * WIDTH, bins)
        self.register_buffer("window", torch.hann_window(FRAME))

    def forward(self, reverberant: torch.Tensor) -> torch.Tensor:
        """Samples [batch, sample] with the late part masked."""
        spectrum = torch.stft(reverberant, FRAME, HOP, window=self.window, return_complex=True)  # [batch, bin, frame]
        levels = torch.log(spectrum.abs() + 1e-5 * spectrum.abs().amax((1, 2), keepdim=True) + 1e-9).transpose(1, 2)
        levels = levels - levels.mean((1, 2), keepdim=True)
        mask = torch.sigmoid(self.out(self.recurrent(levels)[0])).transpose(1, 2)
        return torch.istft(spectrum * mask, FRAME, HOP, window=self.window, length=reverberant.shape[1])


def negative_si_sdr(estimate: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """Mean over the batch [batch, sample], dB."""
    wanted = target * ((estimate * target).sum(1, keepdim=True) / ((target**2).sum(1, keepdim=True) + 1e-9))
    ratio = (wanted**2).sum(1) / (((estimate - wanted) ** 2).sum(1) + 1e-9)
    return -10 * torch.log10(ratio + 1e-9).mean()


def trained(pairs: list[Pair], steps: int, seed: int, say: Callable[[str], None], batch: int = 8, seconds: float = 1.5) -> MaskNetwork:
    torch.manual_seed(seed)
    random, network = np.random.default_rng(seed), MaskNetwork()
    optimizer = torch.optim.Adam(network.parameters(), 1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 2e-3, total_steps=max(steps, 11), pct_start=0.1)
    size = round(seconds * RATE_HZ)
    network.train()
    for step in range(steps):
        cuts = [cut(pairs[random.integers(len(pairs))], size, random) for _ in range(batch)]
        reverberant, early = (torch.from_numpy(np.stack(side)) for side in zip(*cuts, strict=True))
        loss = negative_si_sdr(network(reverberant), early)
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimizer.step()
        schedule.step()
        if (step + 1) % 100 == 0 or step + 1 == steps:
            say(f"update {step + 1}/{steps}, SI-SDR {-float(loss):.1f} dB")
    return network.eval()


def cut(pair: Pair, size: int, random: np.random.Generator) -> Pair:
    """A segment with sound in its target, at the same scale on both sides."""
    reverberant, early = (np.pad(side, (0, max(size - len(side), 0))) for side in pair)
    for _ in range(10):
        first = int(random.integers(0, len(early) - size + 1))
        if np.sum(early[first : first + size] ** 2) > 0.1 * np.mean(early**2) * size:
            break
    scale = 0.1 / max(float(np.sqrt(np.mean(reverberant[first : first + size] ** 2))), 1e-6)
    return (reverberant[first : first + size] * scale).astype(np.float32), (early[first : first + size] * scale).astype(np.float32)


@torch.no_grad()
def masked(network: MaskNetwork, reverberant: np.ndarray) -> np.ndarray:
    scale = 0.1 / max(float(np.sqrt(np.mean(reverberant**2))), 1e-6)
    return network(torch.from_numpy(reverberant * scale)[None])[0].numpy() / scale


def corpus_pairs(arguments: argparse.Namespace, utterances: list[Clip], folder: pathlib.Path) -> list[Pair]:
    """By `earshot dataset rir` and `earshot dataset convolve --early`: input and target as they lie on the disk."""
    speech, (corpus, signals) = kept_speech(utterances, folder), corpus_folders(arguments, utterances, folder)
    run_program(arguments.earshot, "dataset", "rir", arguments.config, "--out", corpus, *corpus_keys(arguments))
    run_program(
        *(arguments.earshot, "dataset", "convolve", corpus, "--speech", speech, "--out", signals),
        *("--early", "--cut", "--count", len(utterances), "--seed", arguments.seed + 1),
    )
    pairs = []
    for line in (signals / "manifest.jsonl").read_text().splitlines():
        entry = json.loads(line)
        reverberant, early = (read(signals / file) for file in (entry["file"], entry["talkers"][0]["early_file"]))
        size = min(len(reverberant), len(early))
        pairs.append((reverberant[:size], early[:size]))
    return pairs


def corpus_keys(arguments: argparse.Namespace) -> list[str]:
    houses = arguments.rooms // 5
    return settings(
        f"shoeboxes.count={arguments.rooms - houses}",
        f'scenes=["house:0..{houses - 1},rooms=3,area_m2=60"]' if houses else "scenes=[]",
        f"sources_per_room={SOURCES}",
        f"listeners_per_source={LISTENERS}",
        "channels=mono",
        f"split_ms={1000 * EARLY_S:g}",
        f"acoustics.sample_rate_hz={RATE_HZ}",
        f"seed={arguments.seed + 1}",
    )


def corpus_folders(arguments: argparse.Namespace, utterances: list[Clip], folder: pathlib.Path) -> tuple[pathlib.Path, pathlib.Path]:
    """Of responses and of signals, named after all that they depend on."""
    made_by = digest(program_digest(arguments.earshot), arguments.config.read_text(), corpus_keys(arguments))
    signals = digest(made_by, [clip.samples for clip in utterances], arguments.seed)
    return folder / f"rir_{made_by}", folder / f"signals_{signals}"


def drawn_pairs(utterances: list[Clip], chosen: list[Response], seed: int) -> list[Pair]:
    random = np.random.default_rng(seed)
    return [pair_of(clip.samples, chosen[random.integers(len(chosen))].samples) for clip in utterances]


@dataclasses.dataclass(frozen=True)
class Test:
    pairs: list[Pair]
    rooms: np.ndarray  # [pair]
    speakers: np.ndarray


def test_of(clips: list[Clip], tested: list[Response]) -> Test:
    pairs = [pair_of(clip.samples, response.samples) for response in tested for clip in clips]
    return Test(
        pairs,
        np.array([response.room for response in tested for _ in clips]),
        np.array([clip.speaker for _ in tested for clip in clips]),
    )


def distances_db(pairs: list[Pair]) -> np.ndarray:
    """Mel-cepstral distance of the first from the second of each pair."""
    from .rooms import RATE_HZ as CEPSTRAL_RATE_HZ
    from .rooms import cepstral_distance_db

    return np.array([cepstral_distance_db(*(resample(side, RATE_HZ, CEPSTRAL_RATE_HZ) for side in pair)) for pair in pairs])


def speech_and_rooms(arguments: argparse.Namespace, folder: pathlib.Path) -> tuple[Speech, list[Response], list[Response], bool]:
    """Speech, responses to test in, measured responses to train in (none without measured rooms), and whether the test is measured."""
    data = arguments.data
    digits = data is not None and (data / "speech/fsdd").is_dir()
    speech = recorded_digits(data / "speech/fsdd") if digits else synthesized_words(DIGITS)
    if data is not None and (data / "rir_measured").is_dir():
        return speech, rooms.measured(data / "rir_measured", "test"), rooms.measured(data / "rir_measured", "train"), True
    return speech, rooms.stand_in(arguments.earshot, arguments.config, 10, folder, 5000), [], False


def network_file(row: str, arguments: argparse.Namespace, utterances: list[Clip], measured: list[Response]) -> pathlib.Path:
    """Named after all that the network is trained with."""
    folder = arguments.out / "dereverb"
    made_by: dict[str, Callable[[], object]] = {
        "earshot": lambda: corpus_folders(arguments, utterances, folder)[1].name,
        "shoebox": lambda: (rooms.boxes_made_by(), arguments.rooms * SOURCES * LISTENERS),
        "measured": lambda: [response.samples for response in measured],
    }
    mark = digest("2", made_by[row](), [clip.samples for clip in utterances], arguments.steps, arguments.seed, EARLY_S, FRAME, HOP, WIDTH)
    return folder / f"{row}_{mark}.pt"


def network_of(file: pathlib.Path, row: str, pairs: Callable[[], list[Pair]], arguments: argparse.Namespace, steps: Steps) -> MaskNetwork:
    """Kept in the output folder: a second run of the same settings reads it."""
    network = MaskNetwork()
    if file.exists():
        network.load_state_dict(torch.load(file))
        return network.eval()
    network = trained(pairs(), arguments.steps, arguments.seed, lambda text: steps.say(f"{row}: {text}"))
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(".part")
    torch.save(network.state_dict(), part)
    part.replace(file)
    return network


def run(arguments: argparse.Namespace) -> str:
    names = tuple(arguments.rows.split(","))
    for name in names:
        if name not in ROWS:
            raise DataError(f"--rows: '{name}' is none of {', '.join(ROWS)}")
    if arguments.seed < 0:
        raise DataError("--seed must be at least 0")
    if min(arguments.steps, arguments.rooms, arguments.utterances, arguments.test_utterances) < 1:
        raise DataError("--steps, --rooms, --utterances and --test-utterances must be at least 1")
    refuse_what_is_no_folder(arguments.data)
    if names == ("measured",) and not (arguments.data and (arguments.data / "rir_measured").is_dir()):
        raise DataError("--rows measured: trains in measured rooms, which --data has not")
    if "shoebox" in names:
        require("pyroomacoustics")
    folder, steps = arguments.out / "dereverb", Steps("dereverb")
    speech, tested, measured_train, is_measured = speech_and_rooms(arguments, folder)
    if not is_measured:
        steps.say("no measured rooms: the test rooms are simulated")
        names = tuple(name for name in names if name != "measured")
    random = np.random.default_rng(arguments.seed + 41)
    utterances = [utterance(speech.train, random) for _ in range(arguments.utterances)]
    test = test_of([utterance(speech.test, random) for _ in range(arguments.test_utterances)], tested)
    makers: dict[str, Callable[[], list[Pair]]] = {
        "earshot": lambda: corpus_pairs(arguments, utterances, folder),
        "shoebox": lambda: drawn_pairs(utterances, rooms.pyroom(arguments.rooms * SOURCES * LISTENERS, arguments.seed + 1), arguments.seed),
        "measured": lambda: drawn_pairs(utterances, measured_train, arguments.seed),
    }
    before = np.array([si_sdr_db(*pair) for pair in test.pairs])
    distance_before = distances_db(test.pairs)
    gains: dict[str, np.ndarray] = {}
    rows: dict[str, dict[str, object]] = {}
    for name in names:
        network = network_of(network_file(name, arguments, utterances, measured_train), name, makers[name], arguments, steps)
        estimates = [masked(network, reverberant) for reverberant, _ in test.pairs]
        after = np.array([si_sdr_db(estimate, early) for estimate, (_, early) in zip(estimates, test.pairs, strict=True)])
        closer = distance_before - distances_db([(estimate, early) for estimate, (_, early) in zip(estimates, test.pairs, strict=True)])
        gains[name] = after - before
        groups = (test.rooms, test.speakers)
        rows[name] = {"si_sdr_gain_db": bootstrap(gains[name], groups), "cepstral_gain_db": bootstrap(closer, groups)}
        if name != names[0]:
            rows[name][f"{names[0]}_less_this_db"] = bootstrap(gains[names[0]] - gains[name], groups)
        steps.say(f"{name}: SI-SDR {interval_text(rows[name]['si_sdr_gain_db'], signed=True)} dB")  # type: ignore[arg-type]
    result = {
        "speech": speech.name,
        "synthesized_speech": speech.synthesized,
        "measured_rooms": is_measured,
        "rooms": len(set(test.rooms)),
        "responses": len(tested),
        "utterances": arguments.test_utterances,
        "si_sdr_before_db": float(before.mean()),
        "cepstral_distance_before_db": float(distance_before.mean()),
        "rows": rows,
        "minutes": steps.minutes(),
    }
    text = text_of(result)
    write_result(arguments.out, "dereverb", result, text)
    return text


def text_of(result: dict[str, object]) -> str:
    where = "measured" if result["measured_rooms"] else "simulated"
    rows: dict[str, dict[str, list[float]]] = result["rows"]  # type: ignore[assignment]
    first = next(iter(rows))
    lines = [
        f"{result['speech']}, {result['responses']} {where} responses of {result['rooms']} rooms: unprocessed SI-SDR "
        f"{result['si_sdr_before_db']:.1f} dB, cepstral distance {result['cepstral_distance_before_db']:.1f} dB",
        "",
        f"| trained in | gain of SI-SDR, dB | gain of cepstral distance, dB | {first} less this, SI-SDR, dB |",
        "|---|---|---|---|",
    ]
    for name, row in rows.items():
        key = f"{first}_less_this_db"
        cells = [interval_text(row["si_sdr_gain_db"], signed=True), interval_text(row["cepstral_gain_db"], signed=True)]
        lines.append(f"| {name} | {' | '.join(cells)} | {interval_text(row[key], signed=True) if key in row else '-'} |")
    return (
        "\n".join(
            [*lines, "", "Brackets: 95 % over rooms and speakers, of one trained network in each row.", f"{result['minutes']:.0f} minutes"]
        )
        + "\n"
    )
