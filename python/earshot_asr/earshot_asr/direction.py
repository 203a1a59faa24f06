# SPDX-License-Identifier: Apache-2.0
"""Direction of arrival in small: a network learns recordings with two ears, and is tested on measured binaural responses.

Two ears hear the angle from the median plane: positive to the left, -90 to 90 degrees, the same in front and behind.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import itertools
import pathlib
import re
from collections.abc import Callable

import numpy as np
import soundfile
import torch
import yaml

from .program import (
    Steps,
    bootstrap,
    digest,
    interval_text,
    kept_speech,
    program_digest,
    read_yaml,
    refuse_what_is_no_folder,
    run_program,
    write_atomically,
    write_result,
)
from .speech import DIGITS, Clip, DataError, Speech, recorded_digits, resample, synthesized_words, utterance
from .speech import RATE_HZ as SPEECH_RATE_HZ

RATE_HZ = 16000
WINDOW_S, LABEL_FRAME_S = 0.5, 0.1
FRAME, HOP = 512, 256
LONGEST_LAG = 16  # 1 ms
FINER = 8  # steps between two lags, for the classical estimate
BANDS_HZ = ((200, 700), (700, 1400), (1400, 2500), (2500, 3800))  # the speech of both sides ends at 4 kHz
LEVEL_BANDS = 12
HEAD_RADIUS_M, SOUND_SPEED_M_PER_S = 0.0875, 343.0
TEST_ROOM = 5  # every fifth room


@dataclasses.dataclass(frozen=True)
class Windows:
    """Half seconds of two ears with one source."""

    features: np.ndarray  # [window, feature]
    classical_deg: np.ndarray
    angle_deg: np.ndarray
    room: np.ndarray
    clip: np.ndarray

    def where(self, chosen: np.ndarray) -> Windows:
        return Windows(*(getattr(self, field.name)[chosen] for field in dataclasses.fields(self)))


def angle_from_median_plane_deg(azimuth_deg: float, elevation_deg: float) -> float:
    return float(np.degrees(np.arcsin(np.sin(np.radians(azimuth_deg)) * np.cos(np.radians(elevation_deg)))))


def phases(window: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean of the normalized cross-spectrum, and the powers of both ears [ear, bin]; frames 20 dB below the loudest do not count."""
    frames = np.lib.stride_tricks.sliding_window_view(window, FRAME, axis=0)[::HOP] * np.hanning(FRAME)  # [frame, ear, sample]
    spectra = np.fft.rfft(frames, 2 * FRAME)
    energy = np.sum(np.abs(spectra) ** 2, axis=(1, 2))
    spectra = spectra[energy > 0.01 * energy.max()]
    cross = spectra[:, 1] * np.conj(spectra[:, 0])
    return (cross / (np.abs(cross) + 1e-12)).mean(0), np.mean(np.abs(spectra) ** 2, axis=0)


def correlation(cross: np.ndarray, low_hz: float, high_hz: float, finer: int = 1) -> np.ndarray:
    """GCC-PHAT (Knapp and Carter 1976) of a band at delays of the right ear from -1 to 1 ms."""
    hz = np.fft.rfftfreq(2 * FRAME, 1 / RATE_HZ)
    inside = (hz >= low_hz) & (hz < high_hz)
    found = np.fft.irfft(np.where(inside, cross, 0), 2 * FRAME * finer)
    reach = LONGEST_LAG * finer
    return np.concatenate([found[-reach:], found[: reach + 1]]) * 2 * FRAME * finer / inside.sum() / 2


def features_of(window: np.ndarray) -> np.ndarray:
    """Correlations of the bands, and differences of level between the ears."""
    cross, powers = phases(window)
    hz = np.fft.rfftfreq(2 * FRAME, 1 / RATE_HZ)
    edges = np.geomspace(BANDS_HZ[0][0], BANDS_HZ[-1][1], LEVEL_BANDS + 1)
    bands = [powers[:, (hz >= low) & (hz < high)].sum(1) + 1e-12 for low, high in itertools.pairwise(edges)]
    levels = [np.log10(left / right) for left, right in bands]
    return np.concatenate([*(correlation(cross, *band) for band in BANDS_HZ), levels]).astype(np.float32)


def classical_angle_deg(window: np.ndarray) -> float:
    """The strongest delay of GCC-PHAT, by the sphere of Woodworth (1938): r / c (angle + sin angle)."""
    found = correlation(phases(window)[0], BANDS_HZ[0][0], BANDS_HZ[-1][1], FINER)
    delay_s = (int(np.argmax(found)) / FINER - LONGEST_LAG) / RATE_HZ
    angles = np.radians(np.arange(-90, 90.5, 0.5))
    return float(np.degrees(np.interp(delay_s, HEAD_RADIUS_M / SOUND_SPEED_M_PER_S * (angles + np.sin(angles)), angles)))


def windows_of(parts: list[tuple[np.ndarray, float, str, str]]) -> Windows:
    """Of (samples [sample, ear], angle, room, clip)."""
    samples, angles, of_room, of_clip = zip(*parts, strict=True)
    return Windows(
        np.array([features_of(s) for s in samples]),
        np.array([classical_angle_deg(s) for s in samples]),
        np.array(angles),
        np.array(of_room),
        np.array(of_clip),
    )


def recorded_windows(folder: pathlib.Path) -> list[tuple[np.ndarray, float, str, str]]:
    """Half seconds of a corpus of `earshot dataset scenes` in which one source emits from one place."""
    found = []
    size = round(WINDOW_S * RATE_HZ)
    frames_of_window = round(WINDOW_S / LABEL_FRAME_S)
    for labels in sorted(folder.glob("*/*.csv")):
        samples, rate = soundfile.read(labels.with_suffix(".wav"), dtype="float32", always_2d=True)
        if rate != RATE_HZ or samples.shape[1] != 2:
            raise DataError(f"{labels.with_suffix('.wav')}: {samples.shape[1]} channels at {rate} Hz are not two ears at {RATE_HZ} Hz")
        with labels.open(newline="") as file:
            rows = [[int(cell) for cell in row] for row in csv.reader(file)]
        by_frame: dict[int, list[list[int]]] = {}
        for row in rows:
            by_frame.setdefault(row[0], []).append(row)
        frame = 0
        last = max(by_frame, default=0)
        while frame + frames_of_window <= last + 1:
            inside = [by_frame.get(f, []) for f in range(frame, frame + frames_of_window)]
            if all(len(rows) == 1 and rows[0][2:5] == inside[0][0][2:5] for rows in inside):
                first = round(frame * LABEL_FRAME_S * RATE_HZ)
                azimuth, elevation = inside[0][0][3:5]
                if first + size <= len(samples):
                    angle = angle_from_median_plane_deg(azimuth, elevation)
                    found.append((samples[first : first + size], angle, labels.stem.split("_")[0], f"{labels.stem} {inside[0][0][2]}"))
                frame += frames_of_window
            else:
                frame += 1
    if not found:
        raise DataError(f"{folder}: holds no half second of a single source")
    return found


def measured_angle_deg(path: pathlib.Path) -> float | None:
    """NAME+40.wav: the head turned by 40 degrees to the left, so that the source lies 40 degrees to the right.  NAME0.wav is ahead where
    such a file is beside it.  None for other names."""
    if match := re.search(r"[+-]\d+$", path.stem):
        return -float(match.group())
    beside = (other.stem for other in path.parent.glob("*.wav"))
    if path.stem.endswith("0") and any(re.fullmatch(re.escape(path.stem[:-1]) + r"[+-]\d+", other) for other in beside):
        return 0.0
    return None


def measured_windows(folder: pathlib.Path, clips: list[Clip]) -> list[tuple[np.ndarray, float, str, str]]:
    """Speech through every binaural response with an angle, in half seconds that are not silent."""
    found = []
    size = round(WINDOW_S * RATE_HZ)
    for path in sorted(folder.glob("*.wav")):
        angle = measured_angle_deg(path)
        if angle is None or soundfile.info(path).channels != 2:
            continue
        response, rate = soundfile.read(path, dtype="float32", always_2d=True)
        ears = [resample(response[:, ear], rate, RATE_HZ) for ear in (0, 1)]
        for i, clip in enumerate(clips):
            dry = resample(clip.samples, SPEECH_RATE_HZ, RATE_HZ)
            wet = np.stack([np.convolve(dry, ear)[: len(dry)] for ear in ears], axis=1)
            level = np.mean(wet**2)
            for first in range(0, len(wet) - size + 1, size):
                window = wet[first : first + size]
                if np.mean(window**2) > 0.1 * level:
                    # A source beyond the side sounds as far from the median plane as one before it.
                    found.append((window, angle_from_median_plane_deg(angle, 0), path.stem, str(i)))
    if not found:
        raise DataError(f"{folder}: holds no binaural responses whose names end with an angle, as NAME+40.wav")
    return found


class AngleNetwork(torch.nn.Module):
    """Angle [window] in degrees: one of its own and the classical one, by a weight that it learns too."""

    def __init__(self, features: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(features))
        self.register_buffer("spread", torch.ones(features))
        self.angle, self.trust = layers(features, 128), layers(features, 64)

    def forward(self, features: torch.Tensor, classical_deg: torch.Tensor) -> torch.Tensor:
        scaled = (features - self.mean) / self.spread
        trust = torch.sigmoid(self.trust(scaled)[:, 0])
        return trust * classical_deg + (1 - trust) * 90 * self.angle(scaled)[:, 0]


def layers(features: int, width: int) -> torch.nn.Sequential:
    return torch.nn.Sequential(
        *(torch.nn.Linear(features, width), torch.nn.ReLU(), torch.nn.Dropout(0.3)),
        *(torch.nn.Linear(width, 64), torch.nn.ReLU(), torch.nn.Linear(64, 1)),
    )


def trained(windows: Windows, steps: int, seed: int, say: Callable[[str], None], batch: int = 64) -> AngleNetwork:
    """Least absolute error.  Every window also comes with the ears exchanged."""
    torch.manual_seed(seed)
    random = np.random.default_rng(seed)
    features = np.concatenate([windows.features, exchanged(windows.features)])
    angles, classical = (np.concatenate([a, -a]).astype(np.float32) for a in (windows.angle_deg, windows.classical_deg))
    network = AngleNetwork(features.shape[1])
    network.mean.copy_(torch.from_numpy(features.mean(0)))
    network.spread.copy_(torch.from_numpy(features.std(0) + 1e-3))
    optimizer = torch.optim.AdamW(network.parameters(), 1e-3, weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 2e-3, total_steps=max(steps, 11), pct_start=0.1)
    for step in range(steps):
        chosen = random.integers(0, len(angles), batch)
        estimate = network(torch.from_numpy(features[chosen]), torch.from_numpy(classical[chosen]))
        loss = (estimate - torch.from_numpy(angles[chosen])).abs().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        if (step + 1) % 500 == 0 or step + 1 == steps:
            say(f"update {step + 1}/{steps}, error {float(loss):.1f} degrees")
    return network.eval()


def exchanged(features: np.ndarray) -> np.ndarray:
    """Those of the other ear."""
    lags = 2 * LONGEST_LAG + 1
    bands = features[:, : len(BANDS_HZ) * lags].reshape(len(features), len(BANDS_HZ), lags)[:, :, ::-1]
    return np.concatenate([bands.reshape(len(features), -1), -features[:, len(BANDS_HZ) * lags :]], axis=1)


@torch.no_grad()
def estimated_deg(network: AngleNetwork, windows: Windows) -> np.ndarray:
    found = network(torch.from_numpy(windows.features), torch.from_numpy(windows.classical_deg.astype(np.float32)))
    return np.clip(found.numpy(), -90, 90)


def corpus_of(arguments: argparse.Namespace, speech: Speech, folder: pathlib.Path) -> pathlib.Path:
    """Recordings with two ears by `earshot dataset scenes`, at rest and one source at a time."""
    file = corpus_config(arguments, speech, folder)
    made = file.with_suffix("")
    run_program(arguments.earshot, "dataset", "scenes", file, "--out", made)
    return made


def corpus_config(arguments: argparse.Namespace, speech: Speech, folder: pathlib.Path) -> pathlib.Path:
    """Written with the speech, and named after all that the recordings depend on."""
    random = np.random.default_rng(arguments.seed + 41)
    sounds = kept_speech([utterance(speech.train, random) for _ in range(60)], folder)
    config = read_yaml(arguments.config)
    for key in ("shoeboxes", "acoustics"):
        if not isinstance(config.get(key), dict):
            raise DataError(f"{arguments.config}: has no keys under '{key}'")
    houses = arguments.rooms // TEST_ROOM
    config |= {"seed": arguments.seed + 1, "classes": {"speech": str(sounds.resolve())}, "channels": "binaural"}
    config |= {"recordings_per_room": 2, "duration_s": 20, "events": [14, 18], "event_s": [0.7, 1.2], "max_overlap": 1, "moving": 0}
    config["scenes"] = [f"house:0..{houses - 1},rooms=3,area_m2=60"] if houses else []
    config["shoeboxes"]["count"] = arguments.rooms - houses
    config["acoustics"]["sample_rate_hz"] = RATE_HZ
    head = arguments.data / "hrtf/MIT_KEMAR_normal_pinna.sofa" if arguments.data else None
    heads = b""
    if head is not None and head.exists():
        config["hrtf"] = str(head.resolve())
        heads = head.read_bytes()
    text = yaml.safe_dump(config)
    file = folder / f"scenes_{digest(program_digest(arguments.earshot), text, heads)}.yaml"
    write_atomically(file, text.encode())
    return file


def errors_of(name: str, windows: Windows, network: AngleNetwork) -> dict[str, object]:
    """Median and mean size of the errors, with intervals over rooms (measured: directions) and clips; the median also less the median error
    with its sign, by which a head may be off its nominal angle."""
    row: dict[str, object] = {"windows": len(windows.room)}
    sides = {"network": estimated_deg(network, windows), "classical": windows.classical_deg}
    for side, estimate in sides.items():
        signed = estimate - windows.angle_deg
        row[side] = {
            "median_deg": bootstrap(np.abs(signed), (windows.room, windows.clip), "median"),
            "mean_deg": bootstrap(np.abs(signed), (windows.room, windows.clip)),
            "offset_deg": float(np.median(signed)),
            "median_less_offset_deg": bootstrap(signed, (windows.room, windows.clip), "scatter"),
            "by_place": {str(room): float(np.median(estimate[windows.room == room])) for room in np.unique(windows.room)},
        }
    gain = np.abs(sides["classical"] - windows.angle_deg) - np.abs(sides["network"] - windows.angle_deg)
    row["classical_less_network_deg"] = bootstrap(gain, (windows.room, windows.clip))
    row["name"] = name
    return row


def run(arguments: argparse.Namespace) -> str:
    if arguments.seed < 0:
        raise DataError("--seed must be at least 0")
    if arguments.steps < 1:
        raise DataError("--steps must be at least 1")
    if arguments.rooms < TEST_ROOM:
        raise DataError(f"--rooms must be at least {TEST_ROOM}")
    refuse_what_is_no_folder(arguments.data)
    data, steps = arguments.data, Steps("direction")
    folder = arguments.measured or (data / "rir_measured/test" if data is not None and (data / "rir_measured/test").is_dir() else None)
    if folder is not None and not folder.is_dir():
        raise DataError(f"{folder}: no such folder")
    if folder is None:
        steps.say("no measured responses: the test rooms are simulated")
    digits = data is not None and (data / "speech/fsdd").is_dir()
    speech = recorded_digits(data / "speech/fsdd") if digits else synthesized_words(DIGITS)
    random = np.random.default_rng(arguments.seed + 42)
    tests = [utterance(speech.test, random) for _ in range(10)]
    measured = windows_of(measured_windows(folder, tests)) if folder is not None else None  # before the corpus: a bad folder ends at once
    corpus = corpus_of(arguments, speech, arguments.out / "direction")
    steps.say("recordings are there")
    windows = windows_of(recorded_windows(corpus))
    held_out = np.array([int(room) % TEST_ROOM == TEST_ROOM - 1 for room in windows.room])
    network = trained(windows.where(~held_out), arguments.steps, arguments.seed, steps.say)
    rows = [errors_of("simulated rooms", windows.where(held_out), network)]
    if measured is not None:
        rows.append(errors_of("measured responses", measured, network))
    result = {
        "speech": speech.name,
        "synthesized_speech": speech.synthesized,
        "measured_rooms": measured is not None,
        "training_windows": int((~held_out).sum()),
        "rows": rows,
        "minutes": steps.minutes(),
    }
    text = text_of(result)
    write_result(arguments.out, "direction", result, text)
    return text


def text_of(result: dict[str, object]) -> str:
    lines = [
        f"{result['speech']}, trained on {result['training_windows']} half seconds of simulated rooms",
        "",
        "| tested on | half seconds | method | median error | mean error | offset | median error less offset |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:  # type: ignore[attr-defined]
        for side, name in (("network", "network"), ("classical", "GCC-PHAT")):
            cells = [interval_text(row[side][key], 1) for key in ("median_deg", "mean_deg", "median_less_offset_deg")]
            shift = f"{row[side]['offset_deg']:+.1f}"
            lines.append(f"| {row['name']} | {row['windows']} | {name} | {cells[0]} | {cells[1]} | {shift} | {cells[2]} |")
        difference = interval_text(row["classical_less_network_deg"], 1, signed=True)
        lines.append(f"| {row['name']} | {row['windows']} | GCC-PHAT less network | - | {difference} | - | - |")
    places = result["rows"][-1]  # type: ignore[index]
    if result["measured_rooms"]:
        lines += ["", "| response | network, degrees | GCC-PHAT |", "|---|---|---|"]
        for place, angle in places["network"]["by_place"].items():
            lines.append(f"| {place} | {angle:+.0f} | {places['classical']['by_place'][place]:+.0f} |")
    lines += ["", "Degrees; brackets: 95 % over rooms (measured: directions) and utterances, of one trained network."]
    lines += ["The simulated test rooms hear the utterances of the training.", f"{result['minutes']:.0f} minutes"]
    return "\n".join(lines) + "\n"
