#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares the stated errors of `earshot rir --metrics` with the errors that it makes.

stated_errors.py --earshot build/release/earshot --out coverage.json [--jobs N] [--seeds 24] [--minutes M]
    [--scenes "NAME;..."] [--modes NAME,...] [--truths FILE]
    Runs every scene in every mode with every seed and writes coverage.json and coverage.md, again after each 20 s.
stated_errors.py --truth NAME [--draws N]
    Prints the truth of a scene whose truth needs no program.

A value is covered if it differs from the truth by at most two standard errors, those of the truth included.
Truths: `images` sums the energies of all image sources of a box of mirrors (Allen and Berkley 1979), `lambert` traces
rays between rectangles that scatter all that they reflect and connects every vertex with the source (own code, numpy),
`high` is the mean of 12 bidirectional runs of the program in the mode `high`, with seeds of their own: there the mode
`high` is judged against means of itself, and a bias that all runs share does not show.  Air takes nothing, and diffraction
and wall_power are off.  Materials have one value for all bands and one truth, except in "house, next room" and "open air",
whose truths are by band.

Columns behind the count of seeds and of runs that failed, for each parameter: the covered fraction of the values with a
stated error, the RMS error (mean error), the RMS of the stated error and the error of the truth; values that are missing,
and those with no error stated, are counted.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from exact_responses import METRICS, Place, draw_truth, jackknife, scenes

TRUTH_SEED = 9_000_000
TRUTH_RUNS = 12
RELATIVE = {"t20_s", "edt_s"}
MODES: dict[str, list[str]] = {
    "fast": ["--preset", "fast", "--set", "field=off"],
    "fast_field": ["--preset", "fast", "--set", "field=on"],
    "balanced": ["--preset", "balanced", "--set", "field=off"],
    "balanced_field": ["--preset", "balanced", "--set", "field=on"],
    "high": ["--preset", "high", "--set", "field=off"],
}


def write_scene(name: str, place: Place, root: Path, folder: Path) -> str:
    """The scene as the program reads it."""
    if not place.sheets:
        return str(root / "configs/scenes" / f"{place.spec}.yaml") if ":" not in place.spec else place.spec
    stem = "".join(c if c.isalnum() else "_" for c in name)
    lines, count = [], 0
    for sheet in place.sheets:
        lines.append(f"usemtl {sheet.kind}")
        lines += [f"v {p[0]:.9g} {p[1]:.9g} {p[2]:.9g}" for p in sheet.corners()]
        lines.append(f"f {count + 1} {count + 2} {count + 3} {count + 4}")
        count += 4
    (folder / f"{stem}.obj").write_text("\n".join(lines) + "\n")
    materials = [
        {"name": kind, "labels": [kind], "absorption": [125, a], "scattering": [125, s], **({"transmission": [125, t]} if t > 0 else {})}
        for kind, (a, s, t) in place.materials.items()
    ]
    (folder / f"{stem}.json").write_text(json.dumps({"materials": materials}))
    assign = "".join(f"  {kind}: {kind}\n" for kind in place.materials)
    (folder / f"{stem}.yaml").write_text(f"mesh: {stem}.obj\nmaterials: {stem}.json\nassign:\n{assign}")
    return str(folder / f"{stem}.yaml")


def run_program(program: str, spec: str, place: Place, options: list[str], seed: int, timeout_s: float) -> dict:
    """Mean over bands is left to the reader: values and errors per band."""
    with tempfile.TemporaryDirectory() as folder:
        metrics = Path(folder) / "metrics.json"
        command = [
            program,
            "rir",
            spec,
            *options,
            "--source",
            ",".join(map(str, place.source)),
            "--listener",
            ",".join(map(str, place.listener)),
            "--seed",
            str(seed),
        ]
        for setting in ("rir_length_s=auto", "threads=1", "air_absorption=off", "diffraction=off", "wall_power=off", *place.settings):
            command += ["--set", setting]
        command += ["--channels", "mono", "--out", str(Path(folder) / "out.wav"), "--metrics", str(metrics)]
        begin = time.monotonic()
        done = subprocess.run(command, capture_output=True, text=True, timeout=timeout_s, check=False)
        if done.returncode != 0:
            return {"error": done.stderr.strip()[-300:]}
        report = json.loads(metrics.read_text())
        errors = report.get("standard_error", {})
        return {
            "seconds": round(time.monotonic() - begin, 2),
            "values": {m: report["energy"].get(m) for m in METRICS},
            "errors": {m: errors.get(m) for m in METRICS},
        }


def mean_truth(runs: list[dict]) -> dict[str, list[tuple[float, float] | None]]:
    """Of runs of the program: per metric and band, mean and standard error."""
    truth: dict[str, list[tuple[float, float] | None]] = {}
    for name in METRICS:
        bands = []
        for of_band in zip(*(r["values"].get(name) or [] for r in runs if r["values"].get(name)), strict=False):
            known = [v for v in of_band if v is not None]
            bands.append(
                (statistics.fmean(known), statistics.stdev(known) / math.sqrt(len(known)))
                if len(known) > len(runs) / 2 and len(known) > 1
                else None
            )
        truth[name] = bands
    return truth


def judge(truth: dict, runs: list[dict]) -> dict:
    """Coverage, size and bias of the errors of one mode in one scene.  Relative for decay times, else dB."""
    result = {}
    for name in METRICS:
        of_metric = truth.get(name)
        if not of_metric:
            continue
        covered, stated, errors, of_truth, silent = [], [], [], [], 0
        for run in runs:
            values, own = run["values"].get(name) or [], run["errors"].get(name) or []
            for band, value in enumerate(values):
                at = of_metric if isinstance(of_metric[0], float) else of_metric[band]
                if at is None:
                    continue
                if value is None:
                    silent += 1
                    continue
                scale = at[0] if name in RELATIVE else 1.0
                errors.append((value - at[0]) / scale)
                of_truth.append(at[1] / scale)
                if band < len(own) and own[band] is not None:
                    stated.append(own[band] / scale)
                    covered.append(abs(value - at[0]) <= 2 * math.hypot(own[band], at[1]))
        if errors or silent:
            result[name] = {
                "covered": round(statistics.fmean(covered), 3) if covered else None,
                "rms": math.sqrt(statistics.fmean([e * e for e in errors])) if errors else None,
                "bias": statistics.fmean(errors) if errors else None,
                "median": statistics.median(errors) if errors else None,
                "stated": math.sqrt(statistics.fmean([e * e for e in stated])) if stated else None,
                "error_of_truth": math.sqrt(statistics.fmean([e * e for e in of_truth])) if of_truth else None,
                "values": len(errors),
                "missing": silent,
                "no_error_stated": len(errors) - len(stated),
            }
    return result


def as_markdown(report: dict) -> str:
    """A row for each scene and mode, with three columns for each parameter: what is covered with the errors, values with no error
    stated, and the error of the truth."""
    heads = [f"{m} | no error stated | error of truth" for m in METRICS]
    lines = ["| scene | truth | mode | seeds | failed | " + " | ".join(heads) + " |", "|---|---|---|---|---|" + "---|---|---|" * len(METRICS)]

    def cell(of: dict | None, name: str) -> str:
        if of is None:
            return " | |"
        if of["rms"] is None:
            return f"none of {of['missing']} | |"
        unit, scale = ("%", 100) if name in RELATIVE else ("dB", 1)
        size = f"{scale * of['rms']:.2g} ({scale * of['bias']:+.2g}) {unit}" + (f", {of['missing']} missing" if of["missing"] else "")
        if of["covered"] is not None:
            size = f"{100 * of['covered']:.0f} %: {size}, stated {scale * of['stated']:.2g}"
        return f"{size} | {of['no_error_stated']} of {of['values']} | {scale * of['error_of_truth']:.2g} {unit}"

    for scene, of_scene in report["scenes"].items():
        for mode, result in of_scene.get("modes", {}).items():
            lines.append(
                f"| {scene} | {of_scene['truth']} | {mode} | {result['seeds']} | {result['failed']} | "
                + " | ".join(cell(result["metrics"].get(m), m) for m in METRICS)
                + " |"
            )
    return "\n".join(lines) + "\n"


class Study:
    def __init__(self, options: argparse.Namespace):
        self.options, self.places = options, scenes()
        names = options.scenes.split(";") if options.scenes else list(self.places)
        self.names = [n for n in self.places if any(n.startswith(part) for part in names)]
        self.modes = options.modes.split(",") if options.modes else list(MODES)
        self.runs: dict = {n: {m: [] for m in self.modes} for n in self.names}
        self.truth_runs: dict = {n: [] for n in self.names}
        self.failures: list[str] = []
        self.failed: dict = {n: dict.fromkeys([*self.modes, None], 0) for n in self.names}  # of runs; None: of truths
        self.truths_file = Path(options.truths) if options.truths else None
        self.known: dict = json.loads(self.truths_file.read_text()) if self.truths_file and self.truths_file.exists() else {}
        self.begin = time.monotonic()

    def jobs(self, folder: Path):
        """In order of need: truths, then seeds of all scenes, the slow mode last."""
        specs = {n: write_scene(n, self.places[n], Path(self.options.root), folder) for n in self.names}
        high = [*MODES["high"]]
        for draw in range(TRUTH_RUNS):
            for name in self.names:
                place = self.places[name]
                if name in self.known:
                    continue
                if place.truth == "high":
                    yield (
                        "truth",
                        name,
                        None,
                        run_program,
                        (self.options.earshot, specs[name], place, high, TRUTH_SEED + draw, self.options.timeout),
                    )
                elif place.truth == "lambert" or draw == 0:
                    yield ("truth", name, None, draw_truth, (name, draw))
        for slow in (False, True):
            for seed in range(self.options.seeds):
                for name in self.names:
                    for mode in self.modes:
                        if (mode == "high") == slow:
                            yield (
                                "run",
                                name,
                                mode,
                                run_program,
                                (self.options.earshot, specs[name], self.places[name], MODES[mode], seed + 1, self.options.timeout),
                            )

    def truth_of(self, name: str) -> dict | None:
        if name in self.known:
            return self.known[name]
        draws, kind = self.truth_runs[name], self.places[name].truth
        if len(draws) < (1 if kind == "images" else 2):
            return None
        return mean_truth(draws) if kind == "high" else jackknife(draws)

    def report(self) -> dict:
        of_scenes = {}
        for name in self.names:
            truth = self.truth_of(name)
            if truth is None:
                continue
            modes = {
                m: {
                    "seeds": len(runs),
                    "failed": self.failed[name][m],
                    "seconds": round(statistics.median(r["seconds"] for r in runs), 2) if runs else None,
                    "metrics": judge(truth, runs),
                }
                for m, runs in self.runs[name].items()
                if runs or self.failed[name][m]
            }
            of_scenes[name] = {
                "truth": self.places[name].truth,
                "failed_truths": self.failed[name][None],
                "truth_values": truth,
                "modes": modes,
            }
        return {"seconds": round(time.monotonic() - self.begin), "failures": self.failures[:20], "scenes": of_scenes}

    def write(self) -> None:
        report, out = self.report(), Path(self.options.out)
        for path, text in ((out, json.dumps(report, indent=1)), (out.with_suffix(".md"), as_markdown(report))):
            part = path.with_suffix(path.suffix + ".part")
            part.write_text(text)
            os.replace(part, path)

    def fail(self, name: str, mode: str | None, error: str) -> None:
        self.failures.append(f"{name}, {mode or 'truth'}: {error}")
        self.failed[name][mode] += 1

    def take(self, kind: str, name: str, mode: str | None, job: concurrent.futures.Future) -> None:
        try:
            result = job.result()
        except Exception as error:  # a run that hangs or a broken scene must not end the study
            self.fail(name, mode, str(error))
            return
        if isinstance(result, dict) and "error" in result:
            self.fail(name, mode, result["error"])
        elif kind == "truth":
            self.truth_runs[name].append(result)
        else:
            self.runs[name][mode].append(result)

    def run(self) -> None:
        os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"
        end, last = self.begin + 60 * self.options.minutes, time.monotonic()
        with tempfile.TemporaryDirectory() as folder, concurrent.futures.ProcessPoolExecutor(self.options.jobs) as pool:
            running: dict = {}
            for kind, name, mode, function, arguments in self.jobs(Path(folder)):
                while len(running) >= 2 * self.options.jobs:
                    done, _ = concurrent.futures.wait(running, return_when=concurrent.futures.FIRST_COMPLETED)
                    for job in done:
                        self.take(*running.pop(job), job)
                if time.monotonic() > last + 20:
                    last = time.monotonic()
                    self.write()
                if time.monotonic() > end:
                    break
                running[pool.submit(function, *arguments)] = (kind, name, mode)
            for job in concurrent.futures.as_completed(list(running)):
                self.take(*running[job], job)
        self.write()
        if self.truths_file:
            whole = {n: self.truth_of(n) for n in self.names if len(self.truth_runs[n]) == TRUTH_RUNS or self.places[n].truth == "images"}
            self.truths_file.write_text(json.dumps({**self.known, **{n: t for n, t in whole.items() if t}}, indent=1))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--earshot", default="build/release/earshot", help="the program")
    parser.add_argument("--out", default="stated_errors.json", help="JSON file to write; a Markdown table is written beside it")
    parser.add_argument("--root", default=str(Path(__file__).resolve().parents[1]), help="folder of the sources, for configs/scenes")
    parser.add_argument("--jobs", type=int, default=2, help="processes at once")
    parser.add_argument("--seeds", type=int, default=24)
    parser.add_argument("--minutes", type=float, default=60, help="after this no further run begins")
    parser.add_argument("--timeout", type=float, default=120, help="seconds for one run")
    parser.add_argument("--scenes", help="beginnings of scene names, separated by ;")
    parser.add_argument("--modes", help=f"of {', '.join(MODES)}")
    parser.add_argument("--truths", help="JSON file of truths: those in it are taken as they are, complete ones are added")
    parser.add_argument("--truth", help="print the truth of this scene and end")
    parser.add_argument("--draws", type=int, default=TRUTH_RUNS)
    options = parser.parse_args()
    if options.truth:
        count = 1 if scenes()[options.truth].truth == "images" else options.draws
        for metric, (value, error) in jackknife([draw_truth(options.truth, i) for i in range(count)]).items():
            print(f"{metric:12} {value:10.4f} +- {error:.4f}")
        return 0
    options.earshot = str(Path(options.earshot).resolve())
    Study(options).run()
    print(Path(options.out).with_suffix(".md").read_text(), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
