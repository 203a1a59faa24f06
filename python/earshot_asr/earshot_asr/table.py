# SPDX-License-Identifier: Apache-2.0
"""The table: one recognizer, trained in several kinds of rooms, tested in measured ones."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import hashlib
import json
import multiprocessing
import os
import pathlib
import sys
import time

import numpy as np
import torch

from . import responses as rooms
from .errors import Outcome, interval, paired_difference, word_errors
from .recognizer import Recognizer
from .responses import Response, deciles, matched, reverberated
from .speech import DIGITS, WORDS, Clip, DataError, Speech, recorded_digits, synthesized_words, utterance

# How many times as many responses as are asked for a pool holds, for the match to choose from.
POOL_FACTOR = 3
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


class Progress:
    """One line of what is done and the time to go, on stderr."""

    def __init__(self, total: int) -> None:
        self.total, self.done, self.start = total, 0, time.monotonic()

    def step(self, text: str) -> None:
        self.done += 1
        spent = time.monotonic() - self.start
        left = spent / self.done * (self.total - self.done)
        print(f"{self.done}/{self.total}  {text}  {spent / 60:.1f} min, {left / 60:.1f} min to go", file=sys.stderr, flush=True)


def speech_of(task: str, options: Options) -> Speech:
    if task == "words":
        return synthesized_words(WORDS)
    if options.data is not None and (options.data / "speech/fsdd").is_dir():
        return recorded_digits(options.data / "speech/fsdd")
    return synthesized_words(DIGITS)


def write_atomically(path: pathlib.Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(path.suffix + f".part{os.getpid()}")
    part.write_bytes(data)
    part.replace(path)


def pool_of(kind: str, count: int, options: Options) -> list[Response]:
    """Kept in the output folder: a second run of the same program and config reads it."""
    made_by = (
        "pyroomacoustics"
        if kind == SHOEBOX
        else rooms.program_version(options.program) + options.config.read_text() + repr(rooms.KINDS[kind])
    )
    mark = hashlib.sha256(f"1 {kind} {count} {made_by}".encode()).hexdigest()[:12]
    file = options.out / "responses" / f"{kind.replace(' ', '_')}_{mark}.npz"
    if file.exists():
        return rooms.unpacked(file)
    if kind == SHOEBOX:
        made = rooms.pyroom(count, seed=1)
    else:
        made = rooms.earshot(options.program, options.config, kind, count, file.with_suffix(""))
    write_atomically(file, rooms.packed(made))
    return made


def test_and_target(options: Options) -> tuple[list[Response], list[Response], bool]:
    """Responses to test in, responses whose spread is matched, and whether they are measured."""
    if options.data is not None and (options.data / "rir_measured").is_dir():
        test = rooms.measured(options.data / "rir_measured", "test")
        if options.measured_elsewhere is not None:
            test += rooms.measured_elsewhere(options.measured_elsewhere)
        return test, rooms.measured(options.data / "rir_measured", "train"), True
    folder = options.out / "responses"
    test, target = (
        rooms.earshot(
            options.program, options.config, "earshot houses high", count, folder / f"stand_in_{first}", first_room=first, per_room=4
        )
        for first, count in ((5000, 4 * 20), (6000, 4 * 31))
    )
    return rooms.one_of_each_room(test), rooms.one_of_each_room(target), False


@dataclasses.dataclass(frozen=True)
class TestSet:
    """Utterances in every test room, and the same ones dry."""

    clips: list[Clip]
    rooms: list[Response]

    def outcome(self, recognizers: list[Recognizer], clean: bool) -> Outcome:
        heard = [clip.samples for clip in self.clips] if clean else [reverberated(c.samples, r) for r in self.rooms for c in self.clips]
        said = [clip.tokens for clip in self.clips] * (1 if clean else len(self.rooms))
        speakers = np.array([clip.speaker for clip in self.clips] * (1 if clean else len(self.rooms)))
        names = sorted({r.room for r in self.rooms})
        of_room = np.zeros(len(said), int) if clean else np.repeat([names.index(r.room) for r in self.rooms], len(self.clips))
        errors = [[word_errors(s, h) for s, h in zip(said, recognizer.recognize(heard), strict=True)] for recognizer in recognizers]
        return Outcome(np.array(errors), np.array([len(s) for s in said]), of_room, speakers)


@dataclasses.dataclass(frozen=True)
class Task:
    """All that a seed needs."""

    name: str
    speech: Speech
    test: TestSet
    target: list[Response]
    options: Options


def run_seed(task: Task, seed: int) -> dict[str, tuple[Outcome, Outcome, dict[str, list[float]] | None]]:
    """Every row: outcome in rooms, outcome without, and the spread of its responses."""
    options, speech = task.options, task.speech
    rows: dict[str, tuple[Outcome, Outcome, dict[str, list[float]] | None]] = {}
    base = Recognizer(len(speech.vocabulary), seed)
    base.train(lambda draw: dry(speech, draw), options.base_steps, seed=1000 + seed)
    for name, kind, count in plan_of(options, len(task.target)):
        recognizer, spread = base.copy(), None
        if kind == DRY:
            # As many updates as the others.
            recognizer.train(lambda draw: dry(speech, draw), options.steps, seed=2000 + seed, rate=1e-3)
        else:
            chosen = task.target if kind == MEASURED else choose(kind, count, task.target, seed, options)
            spread = deciles(chosen)
            recognizer.train(lambda draw, chosen=chosen: wet(speech, chosen, draw), options.steps, seed=2000 + seed, rate=1e-3)
        rows[name] = (task.test.outcome([recognizer], clean=False), task.test.outcome([recognizer], clean=True), spread)
        say(task.name, seed, name, rows[name][0], rows[name][1])
    return rows


def say(task: str, seed: int, name: str, in_rooms: Outcome, clean: Outcome) -> None:
    print(f"{task}, seed {seed}, {name}: {in_rooms.rate():.1f} % in rooms, {clean.rate():.1f} % clean", file=sys.stderr, flush=True)


def run_task(name: str, options: Options) -> dict[str, object]:
    speech = speech_of(name, options)
    test_rooms, target, is_measured = test_and_target(options)
    for row in options.rows:
        if row not in (DRY, MEASURED):
            choose(row, 1, target, 0, options)  # makes its responses
    random = np.random.default_rng(41)
    test = TestSet([utterance(speech.test, random) for _ in range(options.test_strings)], test_rooms)
    task = Task(name, speech, test, target, options)
    progress = Progress(options.seeds)
    by_seed: dict[int, dict[str, tuple[Outcome, Outcome, dict[str, list[float]] | None]]] = {}
    if options.jobs == 1:
        for seed in range(options.seeds):
            by_seed[seed] = run_seed(task, seed)
            progress.step(f"{name}: seed {seed}")
    else:
        with concurrent.futures.ProcessPoolExecutor(options.jobs, multiprocessing.get_context("spawn"), one_thread) as pool:
            waiting = {pool.submit(run_seed, task, seed): seed for seed in range(options.seeds)}
            for done in concurrent.futures.as_completed(waiting):
                by_seed[waiting[done]] = done.result()
                progress.step(f"{name}: seed {waiting[done]}")
    rows = by_seed[0]
    spread: dict[str, object] = {"test rooms": deciles(test_rooms)}
    spread.update({row: parts[2] for row, parts in rows.items() if parts[2]})
    merged = {
        row: {"rooms": merge([by_seed[s][row][0] for s in sorted(by_seed)]), "clean": merge([by_seed[s][row][1] for s in sorted(by_seed)])}
        for row in rows
    }
    return report(name, speech, is_measured, merged, spread, options)


def one_thread() -> None:
    torch.set_num_threads(1)


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


def merge(outcomes: list[Outcome]) -> Outcome:
    return dataclasses.replace(outcomes[0], errors=np.concatenate([outcome.errors for outcome in outcomes]))


def report(
    task: str,
    speech: Speech,
    is_measured: bool,
    merged: dict[str, dict[str, Outcome]],
    spread: dict[str, object],
    options: Options,
) -> dict[str, object]:
    rows = {}
    reference = next((name for name in merged if name.startswith(MEASURED)), None)
    shoebox = next((name for name in reversed(list(merged)) if name.startswith(SHOEBOX)), None)
    for name, sides in merged.items():
        row: dict[str, object] = {
            "word_error_rate": sides["rooms"].rate(),
            "interval": interval(sides["rooms"]),
            "clean": sides["clean"].rate(),
            "seeds": [float(100 * e.sum() / sides["rooms"].words.sum()) for e in sides["rooms"].errors],
        }
        for other, key in ((reference, "less_measured"), (shoebox, "less_shoebox")):
            if other is not None and other != name:
                row[key] = paired_difference(sides["rooms"], merged[other]["rooms"])
        rows[name] = row
    return {
        "task": task,
        "speech": speech.name,
        "synthesized_speech": speech.synthesized,
        "measured_rooms": is_measured,
        "seeds": options.seeds,
        "test_utterances": options.test_strings,
        "rows": rows,
        "responses": spread,
        "shoebox_row": shoebox,
        "measured_row": reference,
    }


def text_of(result: dict[str, object]) -> str:
    """The table as Markdown."""
    said = "synthesized speech" if result["synthesized_speech"] else result["speech"]
    where = "measured rooms" if result["measured_rooms"] else "simulated rooms"
    lines = [
        f"### {result['task']}: {said}, {where}, {result['seeds']} seeds",
        "",
        "| trained in | word errors, % | 95 % | clean, % | less measured, points | less shoebox, points |",
        "|---|---|---|---|---|---|",
    ]
    rows: dict[str, dict[str, object]] = result["rows"]  # type: ignore[assignment]
    for name, row in rows.items():
        low, high = row["interval"]  # type: ignore[misc]

        def difference(key: str, row: dict[str, object] = row) -> str:
            if key not in row:
                return "-"
            value, low, high = row[key]  # type: ignore[misc]
            return f"{value:+.1f} [{low:+.1f}, {high:+.1f}]{'' if low <= 0 <= high else ' *'}"

        lines.append(
            f"| {name} | {row['word_error_rate']:.1f} | {low:.1f} to {high:.1f} | {row['clean']:.1f} "
            f"| {difference('less_measured')} | {difference('less_shoebox')} |"
        )
    lines += ["", "`*`: the interval over rooms, speakers and seeds excludes 0.", ""]
    return "\n".join(lines)


def run(options: Options) -> str:
    if options.data is not None and not options.data.is_dir():
        raise DataError(f"{options.data}: no such folder")
    begin = time.monotonic()
    if options.data is None:
        print("no --data: synthesized speech and simulated test rooms", file=sys.stderr)
    results = [run_task(task, options) for task in options.tasks]
    minutes = (time.monotonic() - begin) / 60
    text = "\n".join(text_of(result) for result in results) + f"\n{minutes:.0f} minutes\n"
    write_atomically(options.out / "table.json", json.dumps({"minutes": minutes, "tasks": results}, indent=1).encode())
    write_atomically(options.out / "table.md", text.encode())
    return text
