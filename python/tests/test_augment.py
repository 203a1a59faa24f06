# SPDX-License-Identifier: Apache-2.0
"""earshot.data.Augment: sums, levels and draws against computations of the test."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from corpora import change_line, make_corpus

import earshot
from earshot.data import ArrayResponses, Augment, Augmented, CorpusResponses, SimulatedResponses

pytest.importorskip("scipy")


def noise(draw: np.random.Generator, samples: int) -> np.ndarray[Any, Any]:
    return draw.standard_normal(samples).astype(np.float32)


def test_signals_are_sums_of_products() -> None:
    """Against the sum by its definition, in 64 bits; 32-bit transforms round by 1e-6 of the peak."""
    draw = np.random.default_rng(5)
    for setting in range(12):
        channels, taps, samples = int(draw.integers(1, 5)), int(draw.integers(1, 900)), int(draw.integers(1, 3000))
        response = draw.standard_normal((channels, taps)).astype(np.float32)
        speech = noise(draw, samples)
        for cut in (False, True):
            made = Augment(ArrayResponses([response], rate_hz=8000), cut=cut)(speech, index=setting)
            full = np.stack([np.convolve(speech.astype(np.float64), row.astype(np.float64)) for row in response])
            expected = full[:, :samples] if cut else full
            assert made.signal.shape == expected.shape
            assert made.signal.dtype == np.float32
            np.testing.assert_allclose(made.signal, expected, atol=3e-6 * np.abs(full).max())
            assert made.labels == {"response": 0, "snr_db": None, "gain": 1.0}


@pytest.mark.parametrize("kind", ["white", "sounds"])
def test_levels_are_those_of_the_labels(kind: str) -> None:
    """Signal minus speech is the noise, as the same draw without noise has the speech alone."""
    draw = np.random.default_rng(6)
    responses = ArrayResponses([draw.standard_normal((2, 50)) for _ in range(4)], rate_hz=8000)
    sounds: Any = "white" if kind == "white" else [noise(draw, length) for length in (7, 400, 5000)]
    ratios = []
    for index in range(40):
        speech = noise(draw, 900)
        dry = Augment(responses, seed=3)(speech, index=index)
        noisy = Augment(responses, seed=3, noise=sounds, snr_db=(-5, 15))(speech, index=index)
        assert noisy.labels["response"] == dry.labels["response"]
        rest = noisy.signal.astype(np.float64) - dry.signal
        ratio = 10 * np.log10(np.sum(dry.signal.astype(np.float64) ** 2) / np.sum(rest**2))
        assert ratio == pytest.approx(noisy.labels["snr_db"], abs=1e-3)
        ratios.append(ratio)
        loud = Augment(responses, seed=3, noise=sounds, snr_db=(-5, 15), level_dbfs=(-40, -20))(speech, index=index)
        level = 10 * np.log10(np.mean(loud.signal.astype(np.float64) ** 2))
        assert -40 <= level <= -20
        np.testing.assert_allclose(loud.signal, noisy.signal * loud.labels["gain"], rtol=1e-5, atol=1e-9)
    # Uniform in 20 dB: the mean of 40 lies within 4 * 20 / sqrt(12 * 40) = 3.7 dB of 5 dB.
    assert abs(np.mean(ratios) - 5) < 3.7
    assert np.min(ratios) < 0 < 10 < np.max(ratios)


def same(a: Augmented, b: Augmented) -> bool:
    return a.signal.tobytes() == b.signal.tobytes() and a.labels == b.labels


def test_results_are_a_function_of_seed_epoch_and_index(tmp_path: Path) -> None:
    corpus = make_corpus(tmp_path / "corpus", 40)
    speech = noise(np.random.default_rng(1), 700)
    augment = Augment(CorpusResponses(corpus), noise="white", seed=5)
    keys = [(epoch, index) for epoch in range(3) for index in range(12)]
    first = {key: augment(speech, epoch=key[0], index=key[1]) for key in keys}
    again = pickle.loads(pickle.dumps(augment))
    for key in reversed(keys):
        assert same(again(speech, epoch=key[0], index=key[1]), first[key])
    assert len({made.signal.tobytes() for made in first.values()}) == len(keys)
    other = Augment(CorpusResponses(corpus), noise="white", seed=6)
    assert not any(same(other(speech, epoch=key[0], index=key[1]), first[key]) for key in keys)


def test_responses_are_drawn_equally_often() -> None:
    responses = ArrayResponses([[float(i + 1)] for i in range(10)], rate_hz=8000)
    augment = Augment(responses)
    counts = np.bincount([augment([1.0], index=index).labels["response"] for index in range(2000)], minlength=10)
    # 200 with a standard deviation of 13.4.
    assert np.abs(counts - 200).max() < 4.5 * 13.4


def test_a_corpus_is_read_as_it_is(tmp_path: Path) -> None:
    corpus = make_corpus(tmp_path / "corpus", 40, channels=1)
    responses = CorpusResponses(corpus, rt60_s=(0.3, 0.6), drr_db=(-6, 0))
    lines = {line["id"]: line for line in responses.corpus.lines}
    expected = [
        line
        for line in lines.values()
        if line["t20_mid_s"] is not None and line["drr_db"] is not None and 0.3 <= line["t20_mid_s"] <= 0.6 and -6 <= line["drr_db"] <= 0
    ]
    assert 0 < len(responses) == len(expected) < 40
    for index, line in enumerate(expected):
        assert responses.labels(index)["response"] == line["id"]
        data = (corpus / line["file"]).read_bytes()
        assert responses[index].tobytes() == data[44:]
    with pytest.raises(earshot.InputError, match="has no response with rt60_s"):
        CorpusResponses(corpus, rt60_s=(5, 6))
    text = pickle.dumps(responses)
    assert len(text) < 1000
    assert len(pickle.loads(text)) == len(responses)
    change_line(corpus, 0, drr_db=1.0)
    with pytest.raises(earshot.InputError, match="has changed since it was opened"):
        pickle.loads(text)


def test_a_gain_is_taken_back(tmp_path: Path) -> None:
    corpus = make_corpus(tmp_path / "corpus", 3)
    before = CorpusResponses(corpus)[1]
    change_line(corpus, 1, gain=0.25)
    assert np.array_equal(CorpusResponses(corpus)[1], 4 * before)


def test_rooms_are_simulated_on_the_fly() -> None:
    responses = SimulatedResponses(6, 3, seed=4, length_s=0.2, channels="binaural", settings={"rays": 32})
    rirs = [responses[i] for i in range(len(responses))]
    assert all(rir.shape == (2, 3200) for rir in rirs)
    assert len({rir.tobytes() for rir in rirs}) == 18
    again = pickle.loads(pickle.dumps(responses))
    for index in reversed(range(18)):
        assert again[index].tobytes() == rirs[index].tobytes()
    scenes = [responses.labels(i)["scene"] for i in range(18)]
    assert len(set(scenes)) == 6
    assert all(scenes[i] == scenes[3 * (i // 3)] for i in range(18))
    for index in range(18):  # the direct sound arrives when the distance says
        first = np.flatnonzero(np.abs(rirs[index]).max(axis=0) > 0.1 * np.abs(rirs[index]).max())[0]
        assert abs(first / 16000 - responses.labels(index)["distance_m"] / 343) < 0.002
    made = Augment(responses, noise="white")(noise(np.random.default_rng(1), 500), index=3)
    assert made.signal.shape == (2, 3699)


def test_what_is_wrong_is_named(tmp_path: Path) -> None:
    one = ArrayResponses([[1.0]], rate_hz=8000)
    cases: list[tuple[Callable[[], Any], str]] = [
        (lambda: ArrayResponses([], rate_hz=8000), "arrays is empty"),
        (lambda: ArrayResponses([[[1.0]], [[1.0], [2.0]]], rate_hz=8000), "response 1 has the shape"),
        (lambda: ArrayResponses([[np.nan]], rate_hz=8000), "not finite"),
        (lambda: Augment(one, noise="pink"), "noise is 'pink'"),
        (lambda: Augment(one, noise=[]), "empty list"),
        (lambda: Augment(one, noise=[[0.0, 0.0]]), "noise 0: is silent"),
        (lambda: Augment(one, snr_db=(5, 1)), "snr_db is"),
        (lambda: Augment(one, level_dbfs=(-10, 3)), "level_dbfs is"),
        (lambda: Augment(one, seed=-1), "seed is -1"),
        (lambda: Augment(one)([], index=0), "speech 0: has the shape"),
        (lambda: Augment(one)([[1.0]], index=7), "speech 7: has the shape"),
        (lambda: Augment(one)([0.0], index=0), "is silent"),
        (lambda: Augment(one)([np.inf], index=0), "not finite"),
        (lambda: Augment(one)([1.0], index=-1), "index is -1"),
        (lambda: Augment(one)([1.0], index=0, epoch=-1), "epoch is -1"),
        (lambda: SimulatedResponses(0), "rooms is 0"),
        (lambda: SimulatedResponses(1, min_size_m=(1, 1, 1)), "sizes from"),
        (lambda: SimulatedResponses(1, absorption=(0, 1)), "absorption is"),
        (lambda: CorpusResponses(tmp_path / "none"), "is no folder"),
    ]
    for make, says in cases:
        with pytest.raises(earshot.InputError, match=says):
            make()
