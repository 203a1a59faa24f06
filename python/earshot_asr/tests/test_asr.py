# SPDX-License-Identifier: Apache-2.0
"""The parts of the table against closed forms, and the commands on wrong input.  Needs numpy, scipy and soundfile; the recognizer torch."""

import json
import pathlib
import subprocess
import sys

import numpy as np
import pytest

soundfile = pytest.importorskip("soundfile")
pytest.importorskip("scipy")

from earshot_asr import errors, responses, speech  # noqa: E402


def exponential(rt60_s: float, drr_db: float, random: np.random.Generator) -> np.ndarray:
    """A click, then noise that decays from 10 ms on, after 30 ms of silence."""
    rate = speech.RATE_HZ
    t = np.arange(round(1.2 * rate)) / rate
    rest = np.where(t < 0.01, 0, 10 ** (-3 * t / rt60_s) * random.standard_normal(len(t)))
    rest *= np.sqrt(10 ** (-drr_db / 10) / np.sum(rest**2))
    rest[0] = 1
    return np.concatenate([np.zeros(round(0.03 * rate)), rest]).astype(np.float32)


def test_decay_time_and_ratio_of_exponential_decays() -> None:
    random = np.random.default_rng(1)
    for _ in range(10):
        rt60_s, drr_db = random.uniform(0.2, 0.9), random.uniform(-8, 6)
        response = responses.prepared(exponential(rt60_s, drr_db, random), speech.RATE_HZ, "room")
        assert response is not None
        # Broadband noise at 4 kHz of width: decay times scatter by 2 %; the window of the ratio is exact.
        assert response.rt60_s == pytest.approx(rt60_s, rel=0.08)
        assert response.drr_db == pytest.approx(drr_db, abs=0.1)
        assert np.sum(response.samples**2) == pytest.approx(1, rel=1e-5)
        assert responses.onset(response.samples) == round(responses.DIRECT_S * speech.RATE_HZ)


def test_a_response_ends_where_40_db_less_is_left() -> None:
    random = np.random.default_rng(11)
    for _ in range(10):
        rt60_s, drr_db = random.uniform(0.3, 0.9), random.uniform(-8, 6)
        samples = exponential(rt60_s, drr_db, random)
        ended = responses.ended(samples)
        energy = np.cumsum(samples.astype(np.float64) ** 2)
        assert energy[len(ended) - 1] / energy[-1] >= 1 - 1e-4 > energy[len(ended) - 2] / energy[-1]
        assert np.sum(ended**2) == pytest.approx(1, rel=1e-5)
        # The fraction of an exponential decay that is left falls by 60 dB in a decay time; its noise scatters by 1 dB.
        tail_db = -10 * np.log10(1 + 10 ** (drr_db / 10))
        seconds = (len(ended) - np.argmax(np.abs(ended))) / speech.RATE_HZ
        assert seconds == pytest.approx(rt60_s * (40 + tail_db) / 60, rel=0.08)


def test_noise_behind_a_decay_does_not_lengthen_it() -> None:
    random = np.random.default_rng(2)
    for _ in range(10):
        rt60_s = random.uniform(0.3, 0.7)
        samples = exponential(rt60_s, -3, random)
        noisy = samples + 10 ** (-50 / 20) * np.abs(samples).max() * 0.1 * random.standard_normal(len(samples)).astype(np.float32)
        assert responses.decay_time_s(noisy[240:]) == pytest.approx(rt60_s, rel=0.12)


def test_matched_responses_are_spread_as_their_target() -> None:
    random = np.random.default_rng(3)

    def drawn(count: int, low: float, high: float) -> list[responses.Response]:
        return [responses.Response(np.ones(1, np.float32), str(i), random.uniform(low, high), random.uniform(-10, 5)) for i in range(count)]

    target, pool = drawn(30, 0.3, 0.6), drawn(3000, 0.1, 1.5)
    for count in (30, 200):
        chosen = responses.matched(pool, target, count, random)
        assert len({id(r) for r in chosen}) == count
        for q in (0.1, 0.5, 0.9):
            assert np.quantile([r.rt60_s for r in chosen], q) == pytest.approx(np.quantile([r.rt60_s for r in target], q), rel=0.1)
            assert np.quantile([r.drr_db for r in chosen], q) == pytest.approx(np.quantile([r.drr_db for r in target], q), abs=1)
    with pytest.raises(speech.DataError, match="smaller than"):
        responses.matched(pool[:10], target, 11, random)


def test_reverberated_speech_is_a_convolution_at_the_level_of_the_speech() -> None:
    random = np.random.default_rng(4)
    samples = random.standard_normal(400).astype(np.float32)
    response = responses.Response(random.standard_normal(50).astype(np.float32), "room", 0.5, 0)
    wet = responses.reverberated(samples, response)
    direct = np.convolve(samples, response.samples)
    assert np.allclose(wet / np.linalg.norm(wet), direct / np.linalg.norm(direct), atol=1e-5)
    assert np.mean(wet[:400] ** 2) == pytest.approx(np.mean(samples**2), rel=1e-4)


@pytest.mark.parametrize(
    ("said", "heard", "count"),
    [
        ("a b c", "a b c", 0),
        ("a b c", "a c", 1),
        ("a b", "a x b", 1),
        ("a b c", "x b y", 2),
        ("a b", "", 2),
        ("", "a b", 2),
        ("a b c d", "b c d a", 2),
    ],
)
def test_word_errors(said: str, heard: str, count: int) -> None:
    assert errors.word_errors(said.split(), heard.split()) == count


def outcome(of_room: list[float], random: np.random.Generator) -> errors.Outcome:
    """Utterances of four words in rooms with these error rates; 200 by ten speakers each, three seeds."""
    rooms = np.repeat(np.arange(len(of_room)), 200)
    rates = np.repeat(of_room, 200)
    drawn = random.binomial(4, rates, (3, len(rates)))
    return errors.Outcome(drawn, np.full(len(rates), 4), rooms, np.tile(np.arange(10), len(rates) // 10))


def test_intervals_follow_the_spread_of_rooms() -> None:
    random = np.random.default_rng(5)
    rates = [0.1, 0.15, 0.2, 0.25, 0.3, 0.35]
    low, high = errors.interval(outcome(rates, random))
    # The mean of six rooms with a spread of 0.085 has a standard error of 0.035 by the bootstrap.
    assert (low + high) / 2 == pytest.approx(22.5, abs=2)
    assert high - low == pytest.approx(2 * 1.96 * 100 * np.std(rates) / np.sqrt(6), rel=0.25)
    # Two recognizers that differ by two points in every room differ for sure, though their intervals overlap.
    value, low, high = errors.paired_difference(outcome([r + 0.02 for r in rates], random), outcome(rates, random))
    assert value == pytest.approx(2, abs=0.8)
    assert low > 0
    value, low, high = errors.paired_difference(outcome(rates, random), outcome(rates, random))
    assert low < 0 < high


def test_layouts_of_other_sets(tmp_path: pathlib.Path) -> None:
    paths = {
        "VUT_FIT_L207/MicID01/SpkID01_20170904_S/01/RIR/IR_sweep.v00.wav": "VUT_FIT_L207",
        "AIR_1_4/air_binaural_stairway_1_1_1_165.wav": "stairway",
        "RIR/RIR_LargeRoom1_far_AnglA.wav": "LargeRoom1",
    }
    random = np.random.default_rng(6)
    for name in paths:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        soundfile.write(tmp_path / name, exponential(0.4, 0, random), speech.RATE_HZ)
    assert {r.room for r in responses.measured_elsewhere(tmp_path)} == set(paths.values())


def test_sentences_of_librispeech_and_of_a_transcription(tmp_path: pathlib.Path) -> None:
    random = np.random.default_rng(7)
    (tmp_path / "84" / "1").mkdir(parents=True)
    for name in ("84/1/84-1-0000.flac", "x-01.wav"):
        soundfile.write(tmp_path / name, 0.1 * random.standard_normal(4000), 16000)
    (tmp_path / "84/1/84-1.trans.txt").write_text("\ufeff84-1-0000 GO DO YOU HEAR\r\n", encoding="utf-8")
    (tmp_path / "transcription").write_text("<s> and mister knightley </s> (x-01)\n")
    found = speech.sentences(tmp_path)
    assert sorted((c.text, c.speaker) for c in found) == [("and mister knightley", "x"), ("go do you hear", "84")]


def test_a_recognizer_learns_tones() -> None:
    pytest.importorskip("torch")
    from earshot_asr.recognizer import Recognizer

    def draw(random: np.random.Generator) -> tuple[np.ndarray, tuple[int, ...]]:
        tokens = tuple(int(t) for t in random.integers(0, 3, random.integers(1, 4)))
        t = np.arange(2000) / speech.RATE_HZ
        parts = [np.concatenate([np.sin(2 * np.pi * (400, 900, 2000)[k] * t), np.zeros(800)]) for k in tokens]
        return np.concatenate(parts).astype(np.float32) + 0.01 * random.standard_normal(2800 * len(tokens), np.float32), tokens

    recognizer = Recognizer(3, seed=1)
    recognizer.train(draw, 250, seed=1, rate=3e-3, batch=16)
    random = np.random.default_rng(9)
    tests = [draw(random) for _ in range(20)]
    heard = recognizer.recognize([samples for samples, _ in tests])
    wrong = sum(errors.word_errors(tokens, found) for (_, tokens), found in zip(tests, heard, strict=True))
    assert wrong <= 0.1 * sum(len(tokens) for _, tokens in tests)


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["table", "--rows", "nothing"], "is none of"),
        (["table", "--tasks", "songs"], "neither digits nor words"),
        (["table", "--data", "/nowhere"], "no such folder"),
        (["table", "--seeds", "0"], "at least 1"),
        (["table", "--earshot", "/nowhere/earshot"], "no such program"),
        (["rooms"], "--data"),
        (["rooms", "--recognizers", "ear"], "is none of"),
    ],
)
def test_wrong_options_end_with_one_line(arguments: list[str], part: str, tmp_path: pathlib.Path) -> None:
    pytest.importorskip("torch")
    command = [sys.executable, "-m", "earshot_asr", *arguments, "--out", str(tmp_path / "out")]
    if "--earshot" not in arguments:
        command += ["--earshot", sys.executable]
    done = subprocess.run(command, capture_output=True, text=True, cwd=pathlib.Path(__file__).parent.parent)
    assert done.returncode == 2, done.stderr
    assert part in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_measured_responses_by_their_index(tmp_path: pathlib.Path) -> None:
    random = np.random.default_rng(10)
    (tmp_path / "test").mkdir()
    index = []
    for i, usable in enumerate([True, False, True]):
        soundfile.write(tmp_path / f"test/r{i}.wav", exponential(0.5, 1, random), speech.RATE_HZ)
        index.append({"file": f"test/r{i}.wav", "room": f"room {i}", "usable": usable})
    (tmp_path / "index.json").write_text(json.dumps(index))
    assert [r.room for r in responses.measured(tmp_path, "test")] == ["room 0", "room 2"]
    with pytest.raises(speech.DataError, match="no measured responses"):
        responses.measured(tmp_path, "train")
