# SPDX-License-Identifier: Apache-2.0
"""The command `table` from end to end on tones, killed and run again; which rows are compared."""

import json
import pathlib
import subprocess
import sys
import time

import numpy as np
import pytest

soundfile = pytest.importorskip("soundfile")
pytest.importorskip("scipy")
pytest.importorskip("torch")

from earshot_asr.training import Options, plan_of  # noqa: E402

from earshot_asr import speech, table, training  # noqa: E402


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """Ten tones as the digits, ten takes of each, and decays of two rooms on both sides."""
    folder, random = tmp_path_factory.mktemp("data"), np.random.default_rng(1)
    (folder / "speech/fsdd").mkdir(parents=True)
    t = np.arange(1200) / speech.RATE_HZ
    for digit in range(10):
        for take in range(10):
            tone = np.sin(2 * np.pi * 300 * 1.25**digit * random.uniform(0.9, 1.1) * t) + 0.1 * random.standard_normal(len(t))
            soundfile.write(folder / f"speech/fsdd/{digit}_ann_{take}.wav", 0.3 * tone, speech.RATE_HZ)
    t = np.arange(8000) / speech.RATE_HZ
    for part in ("train", "test"):
        for room in ("a", "b"):
            (folder / "rir_measured" / part / room).mkdir(parents=True)
            decay = 10 ** (-3 * t / random.uniform(0.4, 0.8)) * random.standard_normal(len(t))
            soundfile.write(folder / "rir_measured" / part / room / "rir.wav", 0.3 * decay / np.abs(decay).max(), speech.RATE_HZ)
    return folder


def command(data: pathlib.Path, out: pathlib.Path) -> list[str]:
    return [
        *(sys.executable, "-m", "earshot_asr", "table", "--data", str(data), "--out", str(out), "--earshot", sys.executable),
        *("--config", str(data / "rir.yaml"), "--rows", "no augmentation,measured", "--tasks", "digits", "--seeds", "2"),
        *("--base-steps", "2", "--steps", "5", "--test-strings", "12", "--jobs", "1"),
    ]


def test_a_run_that_was_killed_ends_with_the_same_table(data: pathlib.Path, tmp_path: pathlib.Path) -> None:
    (data / "rir.yaml").write_text("")
    here = pathlib.Path(__file__).parent.parent
    whole = tmp_path / "whole"
    subprocess.run(command(data, whole), check=True, capture_output=True, cwd=here)

    # On a busy machine a run may end before it is killed: then another one begins.
    for attempt in range(10):
        killed = tmp_path / f"killed{attempt}"
        process = subprocess.Popen(command(data, killed), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=here)
        deadline = time.monotonic() + 600
        while process.poll() is None and not list(killed.glob("seeds/*/*.npz")):
            assert time.monotonic() < deadline
            time.sleep(0.01)
        process.kill()
        process.wait()
        kept = {path: path.stat().st_mtime_ns for path in killed.glob("seeds/*/*.npz")}
        if 0 < len(kept) < 4:
            break
    assert 0 < len(kept) < 4
    # What a write that was cut off leaves is not read.
    (next(iter(kept)).parent / "1_no_augmentation.npz.part7").write_bytes(b"PK")

    subprocess.run(command(data, killed), check=True, capture_output=True, cwd=here)
    assert all(path.stat().st_mtime_ns == when for path, when in kept.items())
    tables = [json.loads((folder / "table.json").read_text())["tasks"] for folder in (whole, killed)]
    assert tables[0] == tables[1]
    assert list(tables[0][0]["rows"]) == ["no augmentation", "measured, 2"]
    assert "2 seeds" in (killed / "table.md").read_text()


class Guesser:
    """In the place of the recognizer: what it hears depends on its seed and on all that it was trained with."""

    def __init__(self, tokens: int, seed: int) -> None:
        self.tokens, self.state = tokens, float(seed)

    def copy(self) -> "Guesser":
        other = Guesser(self.tokens, 0)
        other.state = self.state
        return other

    def train(self, draw, steps: int, seed: int, rate: float = 0) -> None:
        random = np.random.default_rng(seed)
        self.state += sum(float(np.abs(draw(random)[0]).sum()) for _ in range(steps))

    def recognize(self, utterances) -> list[tuple[int, ...]]:
        random = np.random.default_rng(int(1000 * self.state))
        return [tuple(int(t) for t in random.integers(0, self.tokens, 3)) for _ in range(utterances.count)]


def test_a_cut_after_any_row_gives_the_same_table(data: pathlib.Path, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (data / "rir.yaml").write_text("")
    monkeypatch.setattr(training, "Recognizer", Guesser)

    def run(out: pathlib.Path, seeds: int = 3) -> list[dict[str, object]]:
        training.task_of.cache_clear()
        options = Options(
            *(data, out, sys.executable, data / "rir.yaml", ("digits",), (training.DRY, training.MEASURED)),
            seeds=seeds,
            base_steps=5,
            steps=5,
            test_strings=40,
        )
        table.run(options)
        return json.loads((out / "table.json").read_text())["tasks"]

    whole = run(tmp_path / "whole")
    rates = [rate for row in whole[0]["rows"].values() for rate in row["seeds"]]
    assert len(rates) == 6
    assert len(set(rates)) >= 5
    write = training.write_atomically
    for rows in range(6):
        left = rows

        def cut(path: pathlib.Path, content: bytes) -> None:
            nonlocal left
            if left == 0:
                path.with_suffix(".npz.part1").write_bytes(content[:100])
                raise KeyboardInterrupt
            left -= 1
            write(path, content)

        (tmp_path / str(rows)).mkdir()
        monkeypatch.setattr(
            training, "write_atomically", lambda path, content: (path.parent.mkdir(parents=True, exist_ok=True), cut(path, content))
        )
        with pytest.raises(KeyboardInterrupt):
            run(tmp_path / str(rows))
        monkeypatch.setattr(training, "write_atomically", write)
        seeds = rows // 2
        if seeds:  # the table of the whole seeds is there already
            early = json.loads((tmp_path / str(rows) / "table.json").read_text())["tasks"][0]
            assert early["seeds"] == seeds
            assert early["seeds_asked"] == 3
            assert early["rows"]["measured, 2"]["seeds"] == whole[0]["rows"]["measured, 2"]["seeds"][:seeds]
        assert run(tmp_path / str(rows)) == whole


def test_minutes_are_those_of_all_calls_and_other_tasks_are_kept(
    data: pathlib.Path, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (data / "rir.yaml").write_text("")
    monkeypatch.setattr(training, "Recognizer", Guesser)
    monkeypatch.setattr(training, "synthesized_words", lambda words: speech.recorded_digits(data / "speech/fsdd"))

    def run(task: str, seeds: int, test_strings: int = 8) -> dict[str, object]:
        training.task_of.cache_clear()
        options = Options(
            *(data, tmp_path, sys.executable, data / "rir.yaml", (task,), (training.DRY, training.MEASURED)),
            seeds=seeds,
            base_steps=5,
            steps=5,
            test_strings=test_strings,
        )
        table.run(options)
        return json.loads((tmp_path / "table.json").read_text())

    one = run("digits", 1)
    two = run("digits", 2)
    again = run("digits", 2)
    for key in ("minutes", "core_minutes"):
        assert 0 < one[key] < two[key] == again[key]
    both = run("words", 1)
    assert both["tasks"][0] == again["tasks"][0]
    assert [result["task"] for result in both["tasks"]] == ["digits", "words"]
    assert both["minutes"] == pytest.approx(two["minutes"] + both["minutes_of_tasks"]["words"][0])
    # Other settings do not stand in one table.
    assert [result["task"] for result in run("words", 1, test_strings=9)["tasks"]] == ["words"]


def test_rows_and_what_they_are_compared_with() -> None:
    names = [name for name, _, _ in plan_of(Options(None, pathlib.Path(), "", pathlib.Path()), 31)]
    assert len(names) == 2 + 2 * 6
    assert table.others_of("earshot houses, 31", names) == {
        "less_measured": "measured, 31",
        "less_shoebox": "pyroomacoustics shoeboxes, 31",
    }
    assert table.others_of("earshot houses high, 500", names)["less_shoebox"] == "pyroomacoustics shoeboxes, 2000"
    assert table.others_of("pyroomacoustics shoeboxes, 31", names) == {"less_measured": "measured, 31"}
    for kind in ("randomized", "uniform"):
        for count in (31, 2000):
            assert table.others_of(f"earshot houses {kind}, {count}", names)["less_not_randomized"] == f"earshot houses, {count}"
    assert table.others_of("no augmentation", names) == {
        "less_measured": "measured, 31",
        "less_shoebox": "pyroomacoustics shoeboxes, 2000",
    }
