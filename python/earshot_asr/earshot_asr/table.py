# SPDX-License-Identifier: Apache-2.0
"""The table: word errors of every row, with intervals and paired differences."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import json
import multiprocessing
import pathlib
import sys
from collections.abc import Callable

import numpy as np

from .errors import Outcome, interval, paired_difference
from .program import Progress, read_json, require, write_atomically
from .responses import deciles
from .speech import DataError
from .training import DRY, MEASURED, SHOEBOX, Options, Task, choose, run_seed, task_of


def run_task(name: str, options: Options, write: Callable[[dict[str, object]], None]) -> None:
    """`write` gets the report of all whole seeds after every one."""
    task = task_of(name, options)
    seeds = [seed for seed in range(options.seeds) if task.missing(seed)]
    if seeds:
        for row in options.rows:
            if row not in (DRY, MEASURED):
                choose(row, 1, task.target, 0, options)  # makes its responses
    progress = Progress(name, len(seeds))

    def keep(seed: int | None) -> None:
        if seed is not None:
            progress.step(f"seed {seed}")
        if result := report(task):
            write(result)

    keep(None)
    if len(seeds) < 2 or options.jobs == 1:
        for seed in seeds:
            run_seed(name, options, seed)
            keep(seed)
    else:
        with concurrent.futures.ProcessPoolExecutor(options.jobs, multiprocessing.get_context("spawn")) as pool:
            waiting = {pool.submit(run_seed, name, options, seed): seed for seed in seeds}
            for done in concurrent.futures.as_completed(waiting):
                done.result()
                keep(waiting[done])


def merge(outcomes: list[Outcome]) -> Outcome:
    return dataclasses.replace(outcomes[0], errors=np.concatenate([outcome.errors for outcome in outcomes]))


def others_of(name: str, names: list[str]) -> dict[str, str]:
    """The rows that a row is compared with: the measured one; and with as many responses, else with the most, the shoeboxes of
    pyroomacoustics and for other materials the houses as they are."""

    def like(kind: str) -> str | None:
        same = f"{kind}, {name.rpartition(', ')[2]}"
        return same if same in names else next((other for other in reversed(names) if other.rpartition(", ")[0] == kind), None)

    pairs = {"less_measured": like(MEASURED), "less_shoebox": like(SHOEBOX)}
    if name.startswith(("earshot houses randomized", "earshot houses uniform")):
        pairs["less_not_randomized"] = like("earshot houses")
    return {key: other for key, other in pairs.items() if other is not None and other != name}


def minutes_of(task: Task) -> list[float]:
    """Of the wall clock and of cores, of all rows that are kept, whenever they were found."""
    kept = [task.found(seed, name) for seed in range(task.options.seeds) for name, _, _ in task.plan if task.file(seed, name).exists()]
    return [sum(row.seconds[clock] for row in kept) / 60 for clock in (0, 1)]


def kept_results(file: pathlib.Path, settings: str, but: tuple[str, ...]) -> tuple[dict[str, dict[str, object]], dict[str, list[float]]]:
    """Results and minutes of the other tasks of an earlier call with the same settings."""
    if not file.exists():
        return {}, {}
    found: dict[str, object] = read_json(file)  # type: ignore[assignment]
    results = {r["task"]: r for r in found.get("tasks", []) if r.get("settings") == settings and r["task"] not in but}  # type: ignore[attr-defined]
    minutes = found.get("minutes_of_tasks", {})
    return results, {task: minutes.get(task, [0.0, 0.0]) for task in results}  # type: ignore[attr-defined]


def report(task: Task) -> dict[str, object] | None:
    """Of the seeds that are whole; none where no seed is."""
    options = task.options
    whole = [seed for seed in range(options.seeds) if not task.missing(seed)]
    if not whole:
        return None
    found = {name: [task.found(seed, name) for seed in whole] for name, _, _ in task.plan}
    in_rooms = {name: merge([row.rooms for row in parts]) for name, parts in found.items()}
    rows = {}
    for name, outcome in in_rooms.items():
        row: dict[str, object] = {
            "word_error_rate": outcome.rate(),
            "interval": interval(outcome),
            "clean": merge([part.clean for part in found[name]]).rate(),
            "seeds": [float(100 * e.sum() / outcome.words.sum()) for e in outcome.errors],
        }
        for key, other in others_of(name, list(found)).items():
            row[key] = paired_difference(outcome, in_rooms[other])
        rows[name] = row
    spread = {"test rooms": deciles(task.test_rooms)}
    spread.update({name: parts[0].spread for name, parts in found.items() if parts[0].spread})
    return {
        "task": task.name,
        "settings": task.settings,
        "speech": task.speech.name,
        "synthesized_speech": task.speech.synthesized,
        "measured_rooms": task.is_measured,
        "seeds": len(whole),
        "seeds_asked": options.seeds,
        "test_utterances": options.test_strings,
        "rows": rows,
        "responses": spread,
    }


def text_of(result: dict[str, object]) -> str:
    """The table as Markdown."""
    said = "synthesized speech" if result["synthesized_speech"] else result["speech"]
    where = "measured rooms" if result["measured_rooms"] else "simulated rooms"
    seeds = str(result["seeds"]) if result["seeds"] == result["seeds_asked"] else f"{result['seeds']} of {result['seeds_asked']}"
    lines = [
        f"### {result['task']}: {said}, {where}, {seeds} seeds",
        "",
        "| trained in | word errors, % | 95 % | clean, % | less measured, points | less shoebox, points | less not randomized, points |",
        "|---|---|---|---|---|---|---|",
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
            f"| {difference('less_measured')} | {difference('less_shoebox')} | {difference('less_not_randomized')} |"
        )
    lines += ["", "`*`: the interval over rooms, speakers and seeds excludes 0.", ""]
    return "\n".join(lines)


def run(options: Options) -> str:
    if options.data is not None and not options.data.is_dir():
        raise DataError(f"{options.data}: no such folder")
    if SHOEBOX in options.rows:
        require("pyroomacoustics")
    if options.data is None:
        print("no --data: synthesized speech and simulated test rooms", file=sys.stderr)
    file = options.out / "table.json"
    results, minutes = kept_results(file, task_of(options.tasks[0], options).settings, options.tasks)

    def write(result: dict[str, object]) -> None:
        name = str(result["task"])
        results[name], minutes[name] = result, minutes_of(task_of(name, options))
        wall, cores = (sum(of_task[clock] for of_task in minutes.values()) for clock in (0, 1))
        text = "\n".join(text_of(result) for result in results.values())
        text += f"\n{wall:.0f} minutes of all rows, {cores:.0f} of cores, without the making of responses\n"
        whole = {"minutes": wall, "core_minutes": cores, "minutes_of_tasks": minutes, "tasks": list(results.values())}
        write_atomically(file, json.dumps(whole, indent=1).encode())
        write_atomically(options.out / "table.md", text.encode())

    for task in options.tasks:
        run_task(task, options, write)
    return (options.out / "table.md").read_text()
