# SPDX-License-Identifier: Apache-2.0
"""Wrong input ends with one line and exit code 2.  Needs no torch but where a test says so."""

import concurrent.futures
import multiprocessing
import os
import pathlib
import sys
from collections.abc import Callable

import numpy as np
import pytest

soundfile = pytest.importorskip("soundfile")
pytest.importorskip("scipy")
pytest.importorskip("yaml")

from earshot_asr.speech import DataError  # noqa: E402

from earshot_asr import __main__, program, responses, rooms, speech  # noqa: E402


def answer(arguments: list[str], out: pathlib.Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> str:
    """The one line of a command that ends with exit code 2."""
    monkeypatch.setattr(sys, "argv", ["earshot_asr", *arguments, "--out", str(out), "--earshot", sys.executable])
    assert __main__.main() == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1, said
    return said


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("responses: [", "is no YAML"),
        ("just words", "must hold keys"),
        ("responses: []", "no list 'responses'"),
        ("responses: {file: a.wav}", "no list 'responses'"),
        ("responses: [a.wav]", "needs 'file'"),
        ("responses: [{file: a.wav, source: [1, 2, 3]}]", "needs 'file'"),
        ("responses: [{file: a.wav, source: [1, 2], listener: [1, 2, 3]}]", "needs 'file'"),
        ("responses: [{file: a.wav, source: [1, 2, x], listener: [1, 2, 3]}]", "needs 'file'"),
        ("responses: [{source: [1, 2, 3], listener: [1, 2, 3]}]", "needs 'file'"),
    ],
)
def test_malformed_places(
    text: str, part: str, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    places = tmp_path / "places.yaml"
    places.write_text(text)
    said = answer(["rooms", "--data", str(tmp_path), "--places", str(places)], tmp_path / "out", monkeypatch, capsys)
    assert part in said
    assert str(places) in said


def test_no_sentences(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    places = tmp_path / "places.yaml"
    places.write_text("responses: [{file: a.wav, source: [1, 2, 3], listener: [1, 2, 3]}]")
    common = ["rooms", "--data", str(tmp_path), "--places", str(places)]
    assert "holds no sentences" in answer([*common, "--synthesized", "0"], tmp_path / "out", monkeypatch, capsys)


def test_malformed_index_and_memory(tmp_path: pathlib.Path) -> None:
    (tmp_path / "test").mkdir()
    for text in ("[", "{}", '[{"file": "test/a.wav"}]', "[1]", '["a"]'):
        (tmp_path / "index.json").write_text(text)
        with pytest.raises(DataError, match=r"index\.json|holds no measured responses"):
            responses.measured(tmp_path, "test")
    (tmp_path / "heard_whisper.json").write_text('{"a"')
    with pytest.raises(DataError, match="is no JSON"):
        rooms.Hearing("whisper", tmp_path)
    for name in ("x_ann_1", "1_ann_x", "12_ann_1"):
        file = tmp_path / f"{name}.wav"
        soundfile.write(file, np.ones(100) * 0.1, 8000)
        with pytest.raises(DataError, match="DIGIT_SPEAKER_TAKE"):
            speech.recorded_digits(tmp_path)
        file.unlink()


def test_a_voice_that_fails(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for script in ("echo 'no such voice' >&2; exit 1", "exit 0"):
        (tmp_path / "espeak-ng").write_text(f"#!/bin/sh\n{script}\n")
        (tmp_path / "espeak-ng").chmod(0o755)
        monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
        with pytest.raises(DataError, match="espeak-ng -v en-us"):
            speech.synthesized_words(("one",))


def test_a_killed_worker(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def run(arguments: object) -> str:
        with concurrent.futures.ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            pool.submit(os._exit, 9).result()
        return ""

    monkeypatch.setattr(__main__, "run", run)
    assert "a worker process was killed" in answer(["table"], tmp_path / "out", monkeypatch, capsys)


@pytest.mark.parametrize("command", ["dereverb", "direction"])
def test_negative_seeds(command: str, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("torch")
    assert "--seed must be at least 0" in answer([command, "--seed", "-1"], tmp_path / "out", monkeypatch, capsys)


def test_rows_without_their_rooms(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("torch")
    for data in ([], ["--data", str(tmp_path)]):
        said = answer(["dereverb", "--rows", "measured", *data], tmp_path / "out", monkeypatch, capsys)
        assert "trains in measured rooms" in said


def test_malformed_corpus_of_direction(tmp_path: pathlib.Path) -> None:
    pytest.importorskip("torch")
    from test_kept import clips

    from earshot_asr import direction

    for text in ("a: [", "a: 1", "shoeboxes: 3\nacoustics: {}"):
        (tmp_path / "scenes.yaml").write_text(text)
        arguments = __main__.parser().parse_args(["direction", "--out", str(tmp_path), "--config", str(tmp_path / "scenes.yaml")])
        with pytest.raises(DataError, match=r"scenes\.yaml"):
            direction.corpus_config(arguments, speech.Speech("", (), clips(1), [], synthesized=False), tmp_path)


def test_few_updates() -> None:
    pytest.importorskip("torch")
    from earshot_asr import dereverb, direction

    random = np.random.default_rng(1)
    pair = tuple(random.standard_normal((2, 3000)).astype(np.float32))
    windows = direction.Windows(
        random.standard_normal((4, 4 * 33 + 12)).astype(np.float32), np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4)
    )
    trainings: list[Callable[[int], object]] = [
        lambda steps: dereverb.trained([pair], steps, 0, lambda text: None, batch=1, seconds=0.2),
        lambda steps: direction.trained(windows, steps, 0, lambda text: None),
    ]
    for train in trainings:
        for steps in (1, 9, 10, 11, 12):
            train(steps)


def test_yaml_and_json_name_their_file(tmp_path: pathlib.Path) -> None:
    (tmp_path / "file").write_bytes(b"\xff\xfe")
    for read in (program.read_yaml, program.read_json):
        with pytest.raises(DataError, match="file: is no"):
            read(tmp_path / "file")
