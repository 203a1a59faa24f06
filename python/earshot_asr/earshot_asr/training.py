# SPDX-License-Identifier: Apache-2.0
"""One recognizer, trained in several kinds of rooms, tested in measured ones: what a seed of a task does."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import functools
import io
import json
import multiprocessing
import pathlib
import shutil
import sys
import time

import numpy as np
import torch

from . import responses as rooms
from .errors import Outcome, word_errors
from .program import digest, write_atomically
from .recognizer import Recognizer, prepared
from .responses import Response, deciles, matched, reverberated
from .speech import DIGITS, WORDS, Clip, Speech, recorded_digits, synthesized_words, utterance

# How many times as many responses as are asked for a pool holds, for the match to choose from.
POOL_FACTOR = 2
PYROOM_PART = 250  # responses that one process makes and keeps
DRY, MEASURED, SHOEBOX = "no augmentation", "measured", "pyroomacoustics shoeboxes"


@dataclasses.dataclass(frozen=True)
class Options:
    data: pathlib.Path | None
    out: pathlib.Path
    program: str
    config: pathlib.Path
    tasks: tuple[str, ...] = ("digits", "words")
    rows: tuple[str, ...] = (DRY, SHOEBOX, *rooms.KINDS, MEASURED)
    counts: tuple[int, ...] = (31, 2000)
    seeds: int = 5
    base_steps: int = 500
    steps: int = 200
    test_strings: int = 60
    high_at_most: int = 500
    measured_elsewhere: pathlib.Path | None = None
    jobs: int = 1


def speech_of(task: str, options: Options) -> Speech:
    if task == "words":
        return synthesized_words(WORDS)
    if options.data is not None and (options.data / "speech/fsdd").is_dir():
        return recorded_digits(options.data / "speech/fsdd")
    return synthesized_words(DIGITS)


def pool_file(kind: str, count: int, options: Options) -> pathlib.Path:
    """Named after all that the responses depend on."""
    made_by = (PYROOM_PART, rooms.boxes_made_by()) if kind == SHOEBOX else rooms.made_by(options.program, options.config)
    mark = digest("3", kind, count, made_by)
    return options.out / "responses" / f"{kind.replace(' ', '_')}_{mark}.npz"


def make_part(file: pathlib.Path, part: int) -> None:
    if not file.exists():
        write_atomically(file, rooms.packed(rooms.pyroom(PYROOM_PART, seed=part)))


def pool_of(kind: str, count: int, options: Options) -> list[Response]:
    """Kept in the output folder: a second run of the same program and config reads it."""
    file = pool_file(kind, count, options)
    if file.exists():
        return rooms.unpacked(file)
    if kind == SHOEBOX:
        parts = range(-(-count // PYROOM_PART))
        files = [file.with_suffix("") / f"{part}.npz" for part in parts]
        with concurrent.futures.ProcessPoolExecutor(options.jobs, multiprocessing.get_context("spawn")) as pool:
            list(pool.map(make_part, files, parts))
        made = [response for part in files for response in rooms.unpacked(part)]
    else:
        made = rooms.earshot(options.program, options.config, kind, count, file.with_suffix(""))
    write_atomically(file, rooms.packed(made))
    shutil.rmtree(file.with_suffix(""), ignore_errors=True)
    return made


def test_and_target(options: Options) -> tuple[list[Response], list[Response], bool]:
    """Responses to test in, responses whose spread is matched, and whether they are measured."""
    if options.data is not None and (options.data / "rir_measured").is_dir():
        test = rooms.measured(options.data / "rir_measured", "test")
        if options.measured_elsewhere is not None:
            test += rooms.measured_elsewhere(options.measured_elsewhere)
        return test, rooms.measured(options.data / "rir_measured", "train"), True
    test, target = (
        rooms.stand_in(options.program, options.config, count, options.out / "responses", first)
        for first, count in ((5000, 20), (6000, 31))
    )
    return test, target, False


@dataclasses.dataclass(frozen=True)
class Row:
    """What a seed found in one kind of rooms, and the spread of its responses."""

    rooms: Outcome
    clean: Outcome
    spread: dict[str, list[float]] | None
    seconds: tuple[float, float]  # of the wall clock, and of a core


class TestSet:
    """Utterances in every test room, and the same ones dry; their features are made once."""

    def __init__(self, clips: list[Clip], responses: list[Response]) -> None:
        self.clips, self.rooms = clips, responses
        self.clean = prepared([clip.samples for clip in clips])
        self.heard = prepared([reverberated(clip.samples, response) for response in responses for clip in clips])

    def outcome(self, recognizer: Recognizer, clean: bool) -> Outcome:
        times = 1 if clean else len(self.rooms)
        said = [clip.tokens for clip in self.clips] * times
        speakers = np.array([clip.speaker for clip in self.clips] * times)
        names = sorted({r.room for r in self.rooms})
        of_room = np.zeros(len(said), int) if clean else np.repeat([names.index(r.room) for r in self.rooms], len(self.clips))
        found = recognizer.recognize(self.clean if clean else self.heard)
        errors = [word_errors(s, h) for s, h in zip(said, found, strict=True)]
        return Outcome(np.array([errors]), np.array([len(s) for s in said]), of_room, speakers)


class Task:
    """All that a seed needs.  Every row of a seed is kept in the output folder as it comes; a run that was cut off reads them."""

    def __init__(self, name: str, options: Options) -> None:
        self.name, self.options, self.speech = name, options, speech_of(name, options)
        self.test_rooms, self.target, self.is_measured = test_and_target(options)
        random = np.random.default_rng(41)
        self.clips = [utterance(self.speech.test, random) for _ in range(options.test_strings)]
        self.plan = plan_of(options, len(self.target))
        settings = (options.base_steps, options.steps, options.counts, options.high_at_most, POOL_FACTOR, PYROOM_PART)
        made_by = (rooms.made_by(options.program, options.config), rooms.boxes_made_by())
        mark = digest("2", settings, made_by, self.speech.vocabulary, self.speech.train, self.clips, self.test_rooms, self.target)
        self.folder = options.out / "seeds" / f"{name}_{mark}"
        # What the results of all tasks in one table share.
        self.settings = digest(settings, options.test_strings, made_by, self.test_rooms, self.target)
        self.test: TestSet | None = None

    def file(self, seed: int, row: str) -> pathlib.Path:
        return self.folder / f"{seed}_{row.replace(' ', '_').replace(',', '')}.npz"

    def missing(self, seed: int) -> list[tuple[str, str, int]]:
        return [part for part in self.plan if not self.file(seed, part[0]).exists()]

    def run_seed(self, seed: int) -> None:
        """Every row that is missing."""
        missing = self.missing(seed)
        if not missing:
            return
        # What all rows of a seed share is counted in the first one.
        begin, begin_core = time.monotonic(), time.process_time()
        if self.test is None:
            self.test = TestSet(self.clips, self.test_rooms)
        speech, options = self.speech, self.options
        base = Recognizer(len(speech.vocabulary), seed)
        base.train(lambda draw: dry(speech, draw), options.base_steps, seed=1000 + seed)
        for name, kind, count in missing:
            recognizer, spread = base.copy(), None
            if kind == DRY:
                # As many updates as the others.
                recognizer.train(lambda draw: dry(speech, draw), options.steps, seed=2000 + seed, rate=1e-3)
            else:
                chosen = self.target if kind == MEASURED else choose(kind, count, self.target, seed, options)
                spread = deciles(chosen)
                recognizer.train(lambda draw, chosen=chosen: wet(speech, chosen, draw), options.steps, seed=2000 + seed, rate=1e-3)
            in_rooms, clean = (self.test.outcome(recognizer, clean=side) for side in (False, True))
            file = io.BytesIO()
            parts = {f"rooms_{key}": value for key, value in vars(in_rooms).items()}
            parts.update({f"clean_{key}": value for key, value in vars(clean).items()})
            seconds, spent = time.monotonic() - begin, time.process_time() - begin_core
            np.savez(file, spread=json.dumps(spread), seconds=[seconds, spent], **parts)
            write_atomically(self.file(seed, name), file.getvalue())
            begin, begin_core = begin + seconds, begin_core + spent
            print(
                f"{self.name}, seed {seed}, {name}: {in_rooms.rate():.1f} % in rooms, {clean.rate():.1f} % clean, {spent:.0f} s of a core",
                file=sys.stderr,
                flush=True,
            )

    def found(self, seed: int, row: str) -> Row:
        with np.load(self.file(seed, row), allow_pickle=False) as file:
            sides = [
                Outcome(**{key.name: file[f"{side}_{key.name}"] for key in dataclasses.fields(Outcome)}) for side in ("rooms", "clean")
            ]
            return Row(*sides, json.loads(str(file["spread"])), tuple(file["seconds"].tolist()))


@functools.lru_cache(maxsize=1)
def task_of(name: str, options: Options) -> Task:
    """Made once in a process."""
    return Task(name, options)


def run_seed(name: str, options: Options, seed: int) -> None:
    """On one core: the same table whatever the number of jobs."""
    torch.set_num_threads(1)
    task_of(name, options).run_seed(seed)


def plan_of(options: Options, measured_count: int) -> list[tuple[str, str, int]]:
    """Name, kind and number of responses of every row."""
    plan: list[tuple[str, str, int]] = []
    for row in options.rows:
        if row == DRY:
            plan.append((row, row, 0))
        elif row == MEASURED:
            plan.append((f"{row}, {measured_count}", row, measured_count))
        else:
            counts = {min(count, options.high_at_most) if row.endswith("high") else count for count in options.counts}
            plan += [(f"{row}, {count}", row, count) for count in sorted(counts)]
    return plan


def choose(kind: str, count: int, target: list[Response], seed: int, options: Options) -> list[Response]:
    """Shares its pool with all counts and seeds."""
    largest = max(options.counts)
    if kind.endswith("high"):
        largest = min(largest, options.high_at_most)
    pool = pool_of(kind, POOL_FACTOR * largest, options)
    return matched(pool, target, count, np.random.default_rng(100 + seed))


def dry(speech: Speech, random: np.random.Generator) -> tuple[np.ndarray, tuple[int, ...]]:
    clip = utterance(speech.train, random)
    return with_noise(clip.samples, random), clip.tokens


def wet(speech: Speech, chosen: list[Response], random: np.random.Generator) -> tuple[np.ndarray, tuple[int, ...]]:
    clip = utterance(speech.train, random)
    # One in five stays dry, so that clean speech is not forgotten.
    samples = clip.samples if random.random() < 0.2 else reverberated(clip.samples, chosen[random.integers(len(chosen))])
    return with_noise(samples, random), clip.tokens


def with_noise(samples: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """White noise 20 to 50 dB below the speech, the same for all rows."""
    level = float(np.sqrt(np.mean(samples**2))) * 10 ** (-random.uniform(20, 50) / 20)
    return samples + level * random.standard_normal(len(samples), np.float32)
