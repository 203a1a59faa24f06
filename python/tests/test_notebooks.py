# SPDX-License-Identifier: Apache-2.0
"""The notebooks of docs/notebooks run from their first to their last cell, with small parameters."""

from __future__ import annotations

import csv
import json
import math
import os
import wave
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import earshot

FOLDER = Path(__file__).resolve().parents[2] / "docs/notebooks"
OVERRIDES = [  # of a training of seconds
    *("schedule=steps", "total_steps=48", "max_minutes=0", "workers=1", "envs_per_worker=2", "rollout_steps=4"),
    *("env.task.max_steps=60", "policy.hidden_size=8", 'data.train.scenes=["house:1000,rooms=3,area_m2=36"]'),
    *('data.eval.scenes=["house:2000,rooms=3,area_m2=36"]', "data.train.episodes_per_scene=4", "data.eval.episodes_per_scene=2"),
]
#: By notebook, what replaces the cell tagged "parameters".
PARAMETERS = {
    "response_in_three_lines": "STEP_M = 3.0",
    "train_and_watch": f"FOLDER = 'run'\nOVERRIDES = {OVERRIDES}",
    "corpus_in_ten_minutes": "FOLDER = 'corpus'\nHOUSES = 1\nSOURCES = 2\nLISTENERS = 3",
}
NAMES = sorted(PARAMETERS)


def read(name: str) -> dict[str, Any]:
    book: dict[str, Any] = json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))
    if name == "train_and_watch" and "EARSHOT_PROGRAM" not in os.environ:
        pytest.skip("no program (EARSHOT_PROGRAM)")
    for cell in book["cells"]:
        if "parameters" in cell["metadata"].get("tags", []):
            cell["source"] = [PARAMETERS[name]]
    return book


def stands_between(walls: earshot.acoustics.Floats, source: earshot.acoustics.Floats, listener: earshot.acoustics.Floats) -> bool:
    """Whether a wall [n, 2, 3] cuts the straight line between two places on the plan."""

    def side(start: Any, end: Any, place: Any) -> Any:
        along, off = end - start, place - start
        return along[..., 0] * off[..., 2] - along[..., 2] * off[..., 0]

    start, end = walls[:, 0], walls[:, 1]
    apart = side(start, end, source) * side(start, end, listener) < 0
    return bool((apart & (side(source, listener, start) * side(source, listener, end) < 0)).any())


def check_files(name: str, folder: Path) -> None:
    """What the notebook leaves."""
    if name == "corpus_in_ten_minutes":
        rows = list(csv.DictReader((folder / "corpus/labels.csv").open()))
        assert len(rows) == 6
        walls = earshot.Scene("house:0,rooms=3,area_m2=50", preset="fast").section(1.5)
        for row in rows:
            with wave.open(str(folder / "corpus" / row["file"])) as file:
                assert (file.getnchannels(), file.getframerate(), file.getnframes()) == (2, 16000, 12800)
            assert float(row["factor"]) > 0
            source, listener = (np.array([float(row[start + axis]) for axis in "xyz"]) for start in ("source_", ""))
            assert math.dist(source, listener) > 0.05
            assert all(math.isfinite(float(row[key])) for key in ("heading_deg", "t20_1khz_s", "c50_1khz_db"))
            assert math.isnan(float(row["drr_db"])) == stands_between(walls, source, listener)
            assert not float(row["drr_db"]) > 40
    if name == "train_and_watch":
        assert (folder / "run/best.html").stat().st_size > 10_000
        assert (folder / "run/events.jsonl").read_text().count("\n") == 6


def test_every_notebook_is_tested_and_has_no_output() -> None:
    assert sorted(path.stem for path in FOLDER.glob("*.ipynb")) == NAMES
    for name in NAMES:
        book = json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))
        assert book["cells"][0]["source"][0].startswith("# ")
        assert sum("parameters" in cell["metadata"].get("tags", []) for cell in book["cells"]) == 1
        for cell in book["cells"]:
            assert cell["cell_type"] != "code" or (cell["outputs"] == [] and cell["execution_count"] is None)


@pytest.mark.parametrize("name", NAMES)
def test_cells_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a kernel; the last value of a cell is shown as a notebook shows it."""
    matplotlib = pytest.importorskip("matplotlib", reason="no matplotlib")
    matplotlib.use("Agg")
    book = read(name)
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "__main__"}
    for number, cell in enumerate(book["cells"]):
        if cell["cell_type"] != "code":
            continue
        *lines, last = "".join(cell["source"]).rstrip().split("\n")
        where = f"{name}.ipynb, cell {number}"
        try:
            value = compile(last, where, "eval")
        except SyntaxError:  # the last line is no expression by itself
            exec(compile("\n".join([*lines, last]), where, "exec"), names)
            continue
        exec(compile("\n".join(lines), where, "exec"), names)
        shown = eval(value, names)
        if hasattr(shown, "_repr_html_"):
            assert "<" in shown._repr_html_()
    check_files(name, tmp_path)
    matplotlib.pyplot.close("all")


@pytest.mark.parametrize("name", NAMES)
def test_a_kernel_runs_it(name: str, tmp_path: Path) -> None:
    nbclient = pytest.importorskip("nbclient", reason="no nbclient")
    nbformat = pytest.importorskip("nbformat", reason="no nbformat")
    pytest.importorskip("ipykernel", reason="no ipykernel")
    book = nbformat.reads(json.dumps(read(name)), as_version=4)
    nbformat.validate(book)
    done = nbclient.NotebookClient(book, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in done["cells"] if cell["cell_type"] == "code" for output in cell["outputs"]]
    assert not [output for output in outputs if output["output_type"] == "error"]
    if name != "corpus_in_ten_minutes":
        assert any("text/html" in output.get("data", {}) for output in outputs)
    check_files(name, tmp_path)
