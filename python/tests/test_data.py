# SPDX-License-Identifier: Apache-2.0
"""earshot.data: exports of corpora, as files and through the command; test_data_loaders.py reads them with other packages."""

from __future__ import annotations

import hashlib
import io
import json
import os
import random
import re
import signal
import subprocess
import sys
import tarfile
import time
import xml.etree.ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from corpora import PROGRAM, change_line, make_corpus, needs_program, tree, wav_bytes

import earshot
from earshot.data import Corpus, convolve, read_wav, rt60_figure, write_parquet, write_webdataset
from earshot.data.__main__ import main


def command(*arguments: Any) -> list[str]:
    return [sys.executable, "-m", "earshot.data", *map(str, arguments)]


def run(*arguments: Any, **keys: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(*arguments), capture_output=True, text=True, **keys)


def test_shards_hold_the_files_and_the_labels(tmp_path: Path) -> None:
    corpus = make_corpus(tmp_path / "corpus")
    done = run("webdataset", corpus, "--out", tmp_path / "out", "--license", "cc-by-4.0", "--per-shard", 10, "--name", "Rooms")
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{tmp_path / 'out'}: complete, 23 responses in 3 shards; README.md, croissant.json\n"
    found: dict[str, bytes] = {}
    for shard, count in zip(range(3), (10, 10, 3), strict=True):
        with tarfile.open(tmp_path / "out" / "data" / f"train-{shard:05}-of-00003.tar") as tar:
            entries = tar.getmembers()
            assert len(entries) == 2 * count
            for entry in entries:
                assert (entry.mtime, entry.uid, entry.gid, entry.mode, entry.uname) == (0, 0, 0, 0o644, "")
                data = tar.extractfile(entry)
                assert data is not None
                found[entry.name] = data.read()
    labels = (tmp_path / "out" / "labels.jsonl").read_text().splitlines()
    for i, line in enumerate((corpus / "manifest.jsonl").read_text().splitlines()):
        expected = json.loads(line)
        assert found[f"{expected['id']}.wav"] == (corpus / expected["file"]).read_bytes()
        stored = json.loads(found[f"{expected['id']}.json"])
        assert stored == json.loads(labels[i])
        # By the test: the mean of the octaves at 500 Hz and 1 kHz, with a fixed relative error.
        error = None if i % 7 == 6 or i % 5 == 4 else 0.02 * (1 + i % 6)
        assert stored.pop("t20_error") == (None if error is None else pytest.approx(error))
        assert stored.pop("grade") == (None if error is None else "A" if error <= 0.0501 else "B" if error <= 0.1001 else "C")
        assert stored.pop("sample_rate_hz") == 8000
        del expected["file"]
        assert stored == expected


def test_card_and_croissant_state_grades_licences_and_hashes(tmp_path: Path) -> None:
    corpus = make_corpus(tmp_path / "corpus", scene="scenes/flat.glb")
    paths = write_webdataset(corpus, tmp_path / "out", license_id="cc-by-4.0", name="Rooms | of mine", input_licenses={"scenes/": "mit"})
    card = (tmp_path / "out" / "README.md").read_text()
    assert card.startswith('---\npretty_name: "Rooms | of mine"\nlicense: "cc-by-4.0"\n')
    assert "| scenes/flat.glb | mit |" in card
    grades = [Corpus(corpus).t20_error(i) for i in range(23)]
    counts = [
        sum(low < error <= high for error in grades if error is not None) for low, high in ((0, 0.0501), (0.0501, 0.1001), (0.1001, 9))
    ]
    for grade, count in zip("ABC", counts, strict=True):
        assert re.search(rf"^\| {grade} \| .* \| {count} \|$", card, re.MULTILINE)
    assert f"| {grades.count(None)} |" in card
    croissant = json.loads((tmp_path / "out" / "croissant.json").read_text())
    files = {entry["contentUrl"]: entry for entry in croissant["distribution"]}
    assert set(files) == {"labels.jsonl", *(f"data/{path.name}" for path in paths)}
    for url, entry in files.items():
        data = (tmp_path / "out" / url).read_bytes()
        assert entry["sha256"] == hashlib.sha256(data).hexdigest()
        assert entry["contentSize"] == f"{len(data)} B"
    assert {"name": "scenes/flat.glb", "license": "mit", "@type": "sc:CreativeWork"} in croissant["isBasedOn"]


@pytest.mark.parametrize("form", ["webdataset", "parquet"])
def test_bytes_do_not_depend_on_kills(tmp_path: Path, form: str) -> None:
    """SIGKILL at random times, until the command completes; then every byte is that of an uninterrupted run."""
    if form == "parquet":
        pytest.importorskip("pyarrow")
    corpus = make_corpus(tmp_path / "corpus", 400, samples=2000)
    arguments = ("--license", "cc0-1.0", "--per-shard", 2, "--name", "Rooms")
    started = time.monotonic()
    whole = run(form, corpus, "--out", tmp_path / "whole", *arguments)
    assert whole.returncode == 0, whole.stderr
    duration = time.monotonic() - started
    draw = random.Random(7)
    kills, out = 0, tmp_path / "killed"
    for _ in range(200):
        process = subprocess.Popen(command(form, corpus, "--out", out, *arguments), stdout=subprocess.DEVNULL)
        # Kills count from the first file on: before that a run has nothing to lose.
        while process.poll() is None and not (out / "export.json").exists():
            time.sleep(0.002)
        shards = len(list((out / "data").glob("*"))) if (out / "data").exists() else 0
        while process.poll() is None and (len(list((out / "data").glob("*"))) if (out / "data").exists() else 0) <= shards:
            time.sleep(0.002)
        try:
            process.wait(draw.uniform(0, 0.2 * duration))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            kills += process.wait() == -signal.SIGKILL
            continue
        break
    assert process.returncode == 0
    assert kills >= 3
    assert tree(out) == tree(tmp_path / "whole")
    # A run over a complete folder changes nothing.
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*")}
    assert run(form, corpus, "--out", out, *arguments).returncode == 0
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*")} == before


@pytest.mark.parametrize("form", ["webdataset", "parquet"])
def test_a_full_disk_is_one_line_and_loses_nothing(tmp_path: Path, form: str) -> None:
    if form == "parquet":
        pytest.importorskip("pyarrow")
    import resource

    corpus = make_corpus(tmp_path / "corpus", 40, samples=4000)
    arguments = ("--license", "cc0-1.0", "--per-shard", 20, "--name", "Rooms")

    def limit() -> None:  # as a disk that is full: writing beyond fails
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))

    full = run(form, corpus, "--out", tmp_path / "out", *arguments, preexec_fn=limit)
    assert full.returncode == 1
    assert re.fullmatch(
        rf"earshot\.data: .*train-00000-of-00002\.\w+: cannot be written \({os.strerror(27)}\); make room .*\n", full.stderr
    )
    assert list((tmp_path / "out" / "data").iterdir()) == []
    assert run(form, corpus, "--out", tmp_path / "out", *arguments).returncode == 0
    assert run(form, corpus, "--out", tmp_path / "again", *arguments).returncode == 0
    assert tree(tmp_path / "out") == tree(tmp_path / "again")


def refusals(tmp_path: Path) -> list[tuple[str, str]]:
    """Folders that are no corpus, each with what the message says."""
    cases = [(str(tmp_path / "missing"), "is no folder"), (str(tmp_path), "contains no corpus.json")]

    def broken(name: str, says: str) -> Path:
        folder = make_corpus(tmp_path / name, 5)
        cases.append((str(folder), says))
        return folder

    (broken("unfinished", "contains an incomplete corpus") / "manifest.jsonl").unlink()
    (broken("no_json", "is no description of a corpus") / "corpus.json").write_text("{")
    (broken("no_keys", "is no description of a corpus") / "corpus.json").write_text("{}")
    folder = broken("newer", "has version 2 of corpora")
    (folder / "corpus.json").write_text((folder / "corpus.json").read_text().replace('"earshot_corpus": 1', '"earshot_corpus": 2'))
    folder = broken("signals", "holds no responses")
    (folder / "corpus.json").write_text((folder / "corpus.json").read_text().replace('"responses"', '"signals"'))
    folder = broken("fewer", "has 5 lines for 6 responses")
    (folder / "corpus.json").write_text((folder / "corpus.json").read_text().replace('"responses": 5', '"responses": 6'))
    change_line(broken("unknown", "manifest.jsonl:3: has the key 'flavour'"), 2, flavour="sour")
    folder = broken("cut", "manifest.jsonl:5: is no line of a manifest")
    (folder / "manifest.jsonl").write_text((folder / "manifest.jsonl").read_text()[:-20])
    folder = broken("lacks", "lacks the key 'gain'")
    (folder / "manifest.jsonl").write_text((folder / "manifest.jsonl").read_text().replace('"gain"', '"drr_db"'))
    change_line(broken("sofa", "stores its responses in SOFA files"), 0, file="00000/000000_s00.sofa")
    change_line(broken("outside", "outside of itself"), 1, file="../../etc/passwd.wav")
    change_line(broken("id", "cannot be a name of a sample"), 1, id="a.b/c")
    (broken("lost", "cannot be read") / "00000" / "000003_s00_l0000.wav").unlink()
    return cases


def test_wrong_folders_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for number, (folder, says) in enumerate(refusals(tmp_path)):
        assert main(["webdataset", folder, "--out", str(tmp_path / f"out{number}"), "--license", "mit"]) == 2
        error = capsys.readouterr().err
        assert says in error
        assert error.startswith("earshot.data: ")
        assert error.count("\n") == 1
        assert not list((tmp_path / f"out{number}").rglob("*.tar"))


def test_wrong_arguments_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    corpus = make_corpus(tmp_path / "corpus", 5, scene="flat.glb")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("mine")
    (tmp_path / "file").write_text("mine")
    licensed = ["--license", "mit", "--input-license", "flat.glb=mit"]
    for arguments, says in [
        (["--out", "full", *licensed], "holds other files, such as notes.txt"),
        (["--out", "file", *licensed], "is no folder"),
        (["--out", "corpus/out", *licensed], "lies in the corpus itself"),
        (["--out", "corpus", *licensed], "lies in the corpus itself"),
        (["--out", "out", "--license", ""], "license is ''"),
        (["--out", "out", "--license", "a licence"], "license is 'a licence'"),
        (["--out", "out", "--license", "mit"], "flat.glb: has no stated licence; give --input-license 'flat.glb=LICENCE'"),
        (["--out", "out", *licensed, "--input-license", "house=mit"], "'house': names no input"),
        (["--out", "out", *licensed, "--input-license", "flat.glb"], "has no licence; write it as INPUT=ID"),
        (["--out", "out", *licensed, "--per-shard", "0"], "responses_per_shard is 0"),
        (["--out", "out", *licensed, "--name", "two\nlines"], "without control characters"),
    ]:
        assert (
            main(
                [
                    "webdataset",
                    str(corpus),
                    *(str(tmp_path / text) if text in ("full", "file", "out", "corpus", "corpus/out") else text for text in arguments),
                ]
            )
            == 2
        )
        error = capsys.readouterr().err
        assert says in error
        assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()
    assert (tmp_path / "full" / "notes.txt").read_text() == "mine"
    assert sorted(path.name for path in (tmp_path / "full").iterdir()) == ["notes.txt"]


def test_a_folder_of_other_settings_is_not_completed(tmp_path: Path) -> None:
    corpus = make_corpus(tmp_path / "corpus", 5)
    write_webdataset(corpus, tmp_path / "out", license_id="mit", responses_per_shard=2)
    before = tree(tmp_path / "out")
    with pytest.raises(earshot.InputError, match=r"begun with another responses_per_shard \(2 there, 3 here\)"):
        write_webdataset(corpus, tmp_path / "out", license_id="mit", responses_per_shard=3)
    with pytest.raises(earshot.InputError, match=r'begun with another license \("mit" there, "cc0-1.0" here\)'):
        write_webdataset(corpus, tmp_path / "out", license_id="cc0-1.0", responses_per_shard=2)
    change_line(corpus, 2, drr_db=1.0)
    with pytest.raises(earshot.InputError, match="begun with another corpus_sha256"):
        write_webdataset(corpus, tmp_path / "out", license_id="mit", responses_per_shard=2)
    assert tree(tmp_path / "out") == before
    (tmp_path / "out" / "export.json").write_text("[]")
    with pytest.raises(earshot.InputError, match=r"export\.json: is damaged"):
        write_webdataset(corpus, tmp_path / "out", license_id="mit", responses_per_shard=2)


def test_parquet_holds_the_files(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    corpus = make_corpus(tmp_path / "corpus")
    paths = write_parquet(corpus, tmp_path / "out", license_id="mit", responses_per_shard=10)
    rows = [row for path in paths for row in parquet.read_table(path).to_pylist()]
    lines = [json.loads(line) for line in (corpus / "manifest.jsonl").read_text().splitlines()]
    assert len(rows) == len(lines) == 23
    for row, line in zip(rows, lines, strict=True):
        assert row["audio"]["bytes"] == (corpus / line["file"]).read_bytes()
        assert row["audio"]["path"] == Path(line["file"]).name
        assert row["source"] == line["source"]
        assert row["listener"] == {**line["listener"], "hrtf": None}
        assert {key: row[key] for key in line if key not in ("file", "source", "listener")} == {
            key: value for key, value in line.items() if key not in ("file", "source", "listener")
        }


def test_wav_files_come_back_with_their_bits() -> None:
    draw = np.random.default_rng(3)
    for channels in range(1, 11):
        samples = draw.standard_normal((channels, int(draw.integers(0, 50)))).astype(np.float32)
        data = wav_bytes(samples, 1000 * channels)
        read, rate = read_wav(data)
        assert read.tobytes() == samples.tobytes()
        assert (read.shape, rate) == (samples.shape, 1000 * channels)
    for wrong in (b"", b"RIFF", data[:-1], data[:20], b"FORM" + data[4:], data[:20] + b"\1" + data[21:], data[:34] + b"\x10" + data[35:]):
        with pytest.raises(earshot.InputError, match=r"x\.wav: "):
            read_wav(wrong, "x.wav")


def test_figure_counts_the_times(tmp_path: Path) -> None:
    """Heights of the bars against counts by the test."""
    for seed in range(10):
        corpus = make_corpus(tmp_path / f"corpus{seed}", 20 + 30 * seed, samples=4, seed=seed)
        out = tmp_path / f"{seed}.svg"
        assert main(["figure", str(corpus), "--out", str(out), "--title", "A < B"]) == 0
        svg = xml.etree.ElementTree.parse(out).getroot()
        bars = [entry for entry in svg.iter("{http://www.w3.org/2000/svg}rect") if entry.get("fill") == "#3b6ea5"]
        times = np.array([line["t20_mid_s"] for line in Corpus(corpus).lines if line["t20_mid_s"] is not None])
        texts = [entry.text or "" for entry in svg.iter("{http://www.w3.org/2000/svg}text")]
        width = next(float(match.group(1)) for text in texts if (match := re.fullmatch(r"responses per ([\d.]+) s", text)))
        counts = np.bincount((times / width).astype(int))
        heights = np.array([float(bar.get("height", "0")) for bar in bars])
        np.testing.assert_allclose(heights / heights.max(), counts[counts > 0] / counts.max(), atol=0.002)  # a tenth of a pixel of 264
        assert any(f"{len(times)} responses" in text and f"median {np.median(times):.2f} s" in text for text in texts)
        assert "A < B" in texts
    for line in range(20):
        change_line(tmp_path / "corpus0", line, t20_mid_s=None)
    with pytest.raises(earshot.InputError, match="states no reverberation time"):
        rt60_figure(tmp_path / "corpus0")


@needs_program
def test_what_the_program_writes(tmp_path: Path) -> None:
    """Pictures, early and late parts, FLAC, and stated errors, from the program itself."""
    config = tmp_path / "rir.yaml"
    config.write_text(
        "seed: 2\nshoeboxes: {count: 2, max_size_m: [5, 3, 5]}\nsources_per_room: 1\nlisteners_per_source: 3\nsplit_ms: 20\n"
        "stated_errors: true\n"
        "panorama: {width_px: 36, height_px: 12, views: 18}\nacoustics: {rays: 64, rir_length_s: 0.2}\n"
    )
    for form in ("wav", "flac"):
        corpus, out = tmp_path / form, tmp_path / f"{form}_out"
        done = subprocess.run(
            [PROGRAM, "dataset", "rir", config, "--out", corpus, "--set", f"format={form}"], capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        assert main(["webdataset", str(corpus), "--out", str(out), "--license", "mit"]) == 0
        with tarfile.open(out / "data" / "train-00000-of-00001.tar") as tar:
            names = [entry.name.partition(".")[2] for entry in tar.getmembers()]
            assert names == ["json", form, f"early.{form}", f"late.{form}", "rgb.png", "depth.png", "category.png"] * 6
            file = tar.extractfile("000000_s00_l0000.json")
            assert file is not None
            label = json.loads(file.read())
        assert label["grade"] in ("A", "B", "C")
        mid = [i for i, hz in enumerate(Corpus(corpus).bands_hz) if 400 < hz < 1250]
        expected = sum(label["t20_error_s"][i] for i in mid) / sum(label["t20_s"][i] for i in mid)
        assert label["t20_error"] == pytest.approx(expected)
    soundfile = pytest.importorskip("soundfile")
    for index in range(6):
        loud = Corpus(tmp_path / "wav").response(index)
        assert np.abs(loud - Corpus(tmp_path / "flac").response(index)).max() <= 2.0**-23 / Corpus(tmp_path / "flac").lines[index]["gain"]
        data = (tmp_path / "wav" / Corpus(tmp_path / "wav").lines[index]["file"]).read_bytes()
        assert np.array_equal(soundfile.read(io.BytesIO(data), dtype="float32")[0].T, loud)


@needs_program
def test_convolve_is_the_command(tmp_path: Path) -> None:
    """Bytes of ``earshot dataset convolve`` with the same options, and its refusals."""
    config = tmp_path / "rir.yaml"
    config.write_text(
        "seed: 3\nshoeboxes: {count: 60, max_size_m: [8, 4, 8], absorption: [0.1, 0.6]}\nsources_per_room: 2\nlisteners_per_source: 8\n"
        "channels: mono\nacoustics: {rays: 64, rir_length_s: 0.6, sample_rate_hz: 8000}\n"
    )
    corpus, speech = tmp_path / "corpus", tmp_path / "speech"
    assert subprocess.run([PROGRAM, "dataset", "rir", config, "--out", corpus], capture_output=True).returncode == 0
    speech.mkdir()
    draw = np.random.default_rng(1)
    for i in range(3):
        (speech / f"{i}.wav").write_bytes(wav_bytes(0.1 * draw.standard_normal((1, 500)).astype(np.float32), 8000))
    (speech / "bad.wav").write_text("no sound")
    with pytest.raises(earshot.InputError, match=r"bad\.wav"):
        convolve(corpus, speech, tmp_path / "refused")
    made = convolve(corpus, speech, tmp_path / "mine", count=200, skip_bad=True, rt60_s=(0.15, 0.45), drr_db=(-8, 0), dry=True, seed=5)
    assert (made.written, made.total, made.folders_missing, made.left_out) == (200, 200, 0, 1)
    options = ["--count", "200", "--skip-bad", "--rt60", "0.15,0.45", "--drr", "-8,0", "--dry", "--seed", "5"]
    command = [PROGRAM, "dataset", "convolve", str(corpus), "--speech", str(speech), "--out", str(tmp_path / "theirs"), *options]
    assert subprocess.run(command, capture_output=True).returncode == 0
    mine, theirs = tree(tmp_path / "mine"), tree(tmp_path / "theirs")
    for name in ("corpus.json",):  # names its program
        mine.pop(name), theirs.pop(name)
    assert mine == theirs
    talkers = [json.loads(line)["talkers"][0] for line in mine["manifest.jsonl"].splitlines()]
    assert all(0.15 <= talker["t20_mid_s"] <= 0.45 and -8 <= talker["drr_db"] <= 0 for talker in talkers)
    assert (
        convolve(corpus, speech, tmp_path / "mine", count=200, skip_bad=True, rt60_s=(0.15, 0.45), drr_db=(-8, 0), dry=True, seed=5).written
        == 0
    )
    refusals: list[dict[str, Any]] = [
        {"rt60_s": (0.4, 0.2)},
        {"rt60_s": (0.15, 9)},
        {"drr_db": (40, 50)},
        {"rt60_s": (1, 2, 3)},
        {"count": -1},
        {"shard": "3/2"},
    ]
    for wrong in [*refusals, {"talkers": (0, 1)}, {"noise": "synth:nothing"}, {"early": True}]:
        with pytest.raises(earshot.InputError) as error:
            convolve(corpus, speech, tmp_path / "refused", skip_bad=True, **wrong)
        assert "\n" not in str(error.value)
    assert not (tmp_path / "refused").exists()
