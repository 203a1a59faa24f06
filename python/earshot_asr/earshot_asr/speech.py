# SPDX-License-Identifier: Apache-2.0
"""Speech with transcripts: recorded digits, folders in the layout of LibriSpeech, and synthesized words."""

from __future__ import annotations

import dataclasses
import math
import pathlib
import re
import shutil
import subprocess
import tempfile

import numpy as np
import scipy.signal
import soundfile

DIGITS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")
# Twenty words of one and two syllables, far apart in sound.
WORDS = (
    *("yes", "no", "stop", "go", "left", "right", "up", "down", "open", "close", "red"),
    *("green", "blue", "yellow", "house", "window", "kitchen", "garden", "morning", "water"),
)
RATE_HZ = 8000
TEST_TAKES = range(5)  # of the spoken digits: the official test set


class DataError(Exception):
    """What the data lacks, in one line."""


@dataclasses.dataclass(frozen=True)
class Clip:
    """One spoken token or sentence."""

    samples: np.ndarray  # float32, RATE_HZ
    tokens: tuple[int, ...]  # indices into the vocabulary
    speaker: str
    text: str = ""


@dataclasses.dataclass(frozen=True)
class Speech:
    """Clips to train on and to test on; no test clip is trained on."""

    name: str
    vocabulary: tuple[str, ...]
    train: list[Clip]
    test: list[Clip]
    synthesized: bool


def read(path: pathlib.Path, rate_hz: int = RATE_HZ) -> np.ndarray:
    """The first channel at `rate_hz`."""
    samples, rate = soundfile.read(path, dtype="float32", always_2d=True)
    if not np.isfinite(samples).all() or not samples.any():
        raise DataError(f"{path}: is silent or not finite")
    return resample(samples[:, 0], rate, rate_hz)


def resample(samples: np.ndarray, from_hz: float, to_hz: float) -> np.ndarray:
    if from_hz == to_hz:
        return samples.astype(np.float32)
    common = math.gcd(int(from_hz), int(to_hz))
    return scipy.signal.resample_poly(samples, int(to_hz) // common, int(from_hz) // common).astype(np.float32)


def recorded_digits(folder: pathlib.Path) -> Speech:
    """The spoken digits: DIGIT_SPEAKER_TAKE.wav."""
    train: list[Clip] = []
    test: list[Clip] = []
    for path in sorted(folder.glob("*_*_*.wav")):
        digit, speaker, take = path.stem.split("_", 2)
        if not re.fullmatch(r"[0-9]", digit) or not re.fullmatch(r"[0-9]+", take):
            raise DataError(f"{path}: is not named DIGIT_SPEAKER_TAKE.wav")
        clip = Clip(read(path), (int(digit),), speaker, DIGITS[int(digit)])
        (test if int(take) in TEST_TAKES else train).append(clip)
    if not train or not test:
        raise DataError(f"{folder}: holds no spoken digits named DIGIT_SPEAKER_TAKE.wav")
    return Speech("recorded digits", DIGITS, train, test, synthesized=False)


def speak(text: str, wav: pathlib.Path, *options: str) -> None:
    command = ["espeak-ng", *options, "-w", str(wav), text]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0 or not wav.exists():
        last = (done.stderr.strip().splitlines() or [f"ended with {done.returncode}"])[-1]
        raise DataError(f"{' '.join(command[:3])}: {last}")


def synthesized_words(vocabulary: tuple[str, ...], voices: int = 12) -> Speech:
    """Words by espeak-ng: every word by each voice at four speeds and pitches; a third of the voices is for the test alone."""
    if shutil.which("espeak-ng") is None:
        raise DataError("espeak-ng is missing, which speaks where no recordings are given: install it, or give --data DIR")
    accents, timbres = ("en-us", "en-gb", "en-gb-scotland"), ("m1", "f2", "m3", "f4", "m5", "f1", "m7", "f3")
    train: list[Clip] = []
    test: list[Clip] = []
    with tempfile.TemporaryDirectory() as folder:
        wav = pathlib.Path(folder) / "word.wav"
        for voice in range(voices):
            speaker = f"{accents[voice % len(accents)]}+{timbres[voice % len(timbres)]}"
            for token, word in enumerate(vocabulary):
                for take in range(4):
                    speak(word, wav, "-v", speaker, "-s", str(130 + 20 * take), "-p", str(30 + 15 * take))
                    clip = Clip(trimmed(read(wav)), (token,), speaker, word)
                    (test if voice % 3 == 2 else train).append(clip)
    return Speech("synthesized words", vocabulary, train, test, synthesized=True)


def synthesized_sentences(texts: tuple[str, ...], rate_hz: int) -> list[Clip]:
    """By espeak-ng, voices in turn; none where it is missing."""
    if shutil.which("espeak-ng") is None:
        return []
    clips = []
    with tempfile.TemporaryDirectory() as folder:
        wav = pathlib.Path(folder) / "sentence.wav"
        for i, text in enumerate(texts):
            voice = ("en-us+m3", "en-us+f2", "en-gb+m1", "en-gb+f4")[i % 4]
            speak(text, wav, "-v", voice, "-s", "150")
            clips.append(Clip(read(wav, rate_hz), (), voice, text))
    return clips


def trimmed(samples: np.ndarray) -> np.ndarray:
    loud = np.flatnonzero(np.abs(samples) > 0.01 * np.abs(samples).max())
    return samples[loud[0] : loud[-1] + 1]


def sentences(folder: pathlib.Path, rate_hz: int = 16000) -> list[Clip]:
    """Sentences with texts: LibriSpeech (*.trans.txt), or a file `transcription` with NAME TEXT lines, anywhere below the folder."""
    clips: list[Clip] = []
    for listing in sorted([*folder.rglob("*.trans.txt"), *folder.rglob("transcription")]):
        for line in listing.read_text(encoding="utf-8-sig").splitlines():
            line = line.strip()
            if "(" in line and line.endswith(")"):  # <s> TEXT </s> (NAME)
                text, name = line[: line.rindex("(")], line[line.rindex("(") + 1 : -1]
                text = text.replace("<s>", "").replace("</s>", "")
            else:
                name, _, text = line.partition(" ")
            for ending in (".flac", ".wav"):
                path = listing.parent / (name + ending)
                if path.exists():
                    clips.append(Clip(read(path, rate_hz), (), name.split("-")[0], text.strip().lower()))
                    break
    return clips


def utterance(clips: list[Clip], random: np.random.Generator, shortest: int = 2, longest: int = 4) -> Clip:
    """Tokens of one speaker, one after the other with gaps of up to 0.2 s."""
    first = clips[random.integers(len(clips))]
    own = [clip for clip in clips if clip.speaker == first.speaker]
    parts, tokens, words = [], [], []
    for _ in range(random.integers(shortest, longest + 1)):
        clip = own[random.integers(len(own))]
        level = float(np.sqrt(np.mean(clip.samples**2)))
        parts += [clip.samples / max(level, 1e-6), np.zeros(random.integers(0, RATE_HZ // 5), np.float32)]
        tokens += clip.tokens
        words.append(clip.text)
    return Clip(0.1 * np.concatenate(parts).astype(np.float32), tuple(tokens), first.speaker, " ".join(words))
