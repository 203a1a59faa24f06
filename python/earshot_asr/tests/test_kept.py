# SPDX-License-Identifier: Apache-2.0
"""What is kept is named after all that it depends on: other data, settings or programs have other files."""

import argparse
import dataclasses
import pathlib

import numpy as np
import pytest

soundfile = pytest.importorskip("soundfile")
pytest.importorskip("scipy")
pytest.importorskip("yaml")

from earshot_asr.responses import Response  # noqa: E402
from earshot_asr.speech import DIGITS, Clip, Speech  # noqa: E402

from earshot_asr import program, responses  # noqa: E402


def clips(seed: int, count: int = 12) -> list[Clip]:
    random = np.random.default_rng(seed)
    return [Clip(random.standard_normal(900).astype(np.float32), (i % 10,), f"speaker {i % 2}") for i in range(count)]


def heard_in(seed: int, count: int = 3) -> list[Response]:
    random = np.random.default_rng(seed)
    return [Response(random.standard_normal(50).astype(np.float32), f"room {i}", 0.5, 0.0) for i in range(count)]


def program_of(folder: pathlib.Path, text: str) -> str:
    file = folder / f"program{len(list(folder.glob('program*')))}"
    file.write_text(text)
    file.chmod(0o755)
    return str(file)


def test_a_digest_depends_on_every_part() -> None:
    random = np.random.default_rng(1)
    samples = random.standard_normal(20).astype(np.float32)
    seen = {program.digest()}
    for i in range(20):
        other = samples.copy()
        other[i] = np.nextafter(other[i], np.float32(9))
        seen.add(program.digest(other))
    clip = clips(2, 1)[0]
    parts = [
        *(samples, samples[:10], [samples[:10], samples[10:]], samples.reshape(2, 10), samples.astype(np.float64)),
        *(clip, dataclasses.replace(clip, tokens=(1, 2)), dataclasses.replace(clip, speaker="other"), [clip], [clip, clip]),
        *(["ab", "c"], ["a", "bc"], [["a"], "bc"], 1, "1", b"1", {"a": 1}, {"a": 2}),
    ]
    seen |= {program.digest(part) for part in parts}
    assert len(seen) == 1 + 20 + len(parts)
    assert program.digest(clips(2)) == program.digest(clips(2))


def test_another_build_of_one_version_is_another_program(tmp_path: pathlib.Path) -> None:
    config = tmp_path / "rir.yaml"
    config.write_text("a: 1\n")
    first, same, other = (program_of(tmp_path, f"#!/bin/sh\necho earshot 1.2.3\n{end}") for end in ("", "", "true\n"))
    assert program.program_digest(first) == program.program_digest(same) != program.program_digest(other)
    assert responses.made_by(first, config) == responses.made_by(same, config) != responses.made_by(other, config)
    before = responses.made_by(first, config)
    config.write_text("a: 2\n")
    assert responses.made_by(first, config) != before


def test_other_utterances_lie_in_another_folder(tmp_path: pathlib.Path) -> None:
    folders = {program.kept_speech(clips(seed), tmp_path) for seed in range(10)}
    assert len(folders) == 10
    for seed in range(10):
        folder = program.kept_speech(clips(seed), tmp_path)
        assert folder in folders
        for clip, file in zip(clips(seed), sorted(folder.iterdir()), strict=True):
            assert np.array_equal(soundfile.read(file, dtype="float32")[0], clip.samples)


def test_networks_of_dereverb_are_named_after_what_they_are_trained_with(tmp_path: pathlib.Path) -> None:
    pytest.importorskip("torch")
    from earshot_asr import dereverb

    config = tmp_path / "rir.yaml"
    config.write_text("a: 1\n")
    settings = {"out": tmp_path, "earshot": program_of(tmp_path, "a"), "config": config, "rooms": 20, "steps": 400, "seed": 0}

    def file(row: str, speech: int = 1, rooms: int = 1, **other: object) -> pathlib.Path:
        return dereverb.network_file(row, argparse.Namespace(**(settings | other)), clips(speech), heard_in(rooms))

    another = program_of(tmp_path, "b")
    for row in dereverb.ROWS:
        first = file(row)
        assert file(row) == first
        assert len({first, file(row, speech=2), file(row, steps=401), file(row, seed=1)}) == 4
        # Each depends on its own responses alone.
        assert (file(row, rooms=2) != first) == (row == "measured")
        assert (file(row, earshot=another) != first) == (row == "earshot")
    namespace = argparse.Namespace(**settings)
    corpus, signals = dereverb.corpus_folders(namespace, clips(1), tmp_path)
    for other in ({"seed": 1}, {"rooms": 21}, {"earshot": another}):
        changed = dereverb.corpus_folders(argparse.Namespace(**(settings | other)), clips(1), tmp_path)
        assert changed[0] != corpus
        assert changed[1] != signals
    changed = dereverb.corpus_folders(namespace, clips(2), tmp_path)
    assert changed[0] == corpus
    assert changed[1] != signals


def test_recordings_of_direction_are_named_after_their_speech(tmp_path: pathlib.Path) -> None:
    pytest.importorskip("torch")
    from earshot_asr import direction

    config = tmp_path / "scenes.yaml"
    config.write_text("shoeboxes: {}\nacoustics: {}\n")
    data = tmp_path / "data"
    settings = {"earshot": program_of(tmp_path, "a"), "config": config, "rooms": 5, "seed": 0, "data": data}
    (data / "hrtf").mkdir(parents=True)
    head = data / "hrtf/MIT_KEMAR_normal_pinna.sofa"

    def file(speech: int = 1, **other: object) -> pathlib.Path:
        said = Speech("", DIGITS, clips(speech), [], synthesized=False)
        return direction.corpus_config(argparse.Namespace(**(settings | other)), said, tmp_path)

    seen = {file(), file(2), file(seed=1), file(rooms=10), file(earshot=program_of(tmp_path, "b"))}
    for heads in (b"a", b"b"):
        head.write_bytes(heads)
        seen.add(file())
    assert len(seen) == 7
    assert file() in seen


def test_kept_rows_of_the_table_depend_on_all_that_they_were_found_with(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("torch")
    from earshot_asr import training

    (tmp_path / "rir.yaml").write_text("")
    options = training.Options(None, tmp_path, program_of(tmp_path, "a"), tmp_path / "rir.yaml", test_strings=3)
    speech, rooms = Speech("", DIGITS, clips(1), clips(2), synthesized=False), heard_in(1)

    def folder(speech: Speech = speech, rooms: list[Response] = rooms, options: training.Options = options) -> pathlib.Path:
        monkeypatch.setattr(training, "speech_of", lambda name, options: speech)
        monkeypatch.setattr(training, "test_and_target", lambda options: (rooms, heard_in(9), True))
        return training.Task("digits", options).folder

    first = folder()
    assert folder() == first
    tokens = [dataclasses.replace(clip, tokens=(3,)) for clip in speech.train]
    seen = {first, folder(dataclasses.replace(speech, train=tokens)), folder(dataclasses.replace(speech, train=clips(3)))}
    seen.add(folder(rooms=[dataclasses.replace(room, room="elsewhere") for room in rooms]))
    seen.add(folder(options=dataclasses.replace(options, program=program_of(tmp_path, "b"))))
    seen.add(folder(options=dataclasses.replace(options, steps=7)))
    for module, name in ((responses, "RESPONSES_PER_BOX"), (responses, "RESPONSES_PER_HOUSE"), (training, "PYROOM_PART")):
        with monkeypatch.context() as changed:
            changed.setattr(module, name, 7)
            seen.add(folder())
    with monkeypatch.context() as changed:
        changed.setattr(responses, "package_version", lambda name: "99")
        seen.add(folder())
    assert len(seen) == 10
