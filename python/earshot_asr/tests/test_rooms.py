# SPDX-License-Identifier: Apache-2.0
"""The two sides of one room, and intervals, against closed forms.  Needs numpy, scipy, soundfile and pyyaml."""

import numpy as np
import pytest

pytest.importorskip("soundfile")
pytest.importorskip("scipy")
pytest.importorskip("yaml")

from earshot_asr import program, rooms


def test_interval_of_a_mean_is_that_of_its_groups() -> None:
    random = np.random.default_rng(1)
    for _ in range(10):
        of_group = random.normal(3, 2, 40)
        values = np.repeat(of_group, 25) + 0.01 * random.standard_normal(1000)
        middle, low, high = program.bootstrap(values, [np.repeat(np.arange(40), 25)])
        assert middle == pytest.approx(values.mean())
        # The standard error of a mean of 40 groups; 2,000 draws scatter the width by 4 %.
        assert high - low == pytest.approx(2 * 1.96 * of_group.std() / np.sqrt(40), rel=0.2)
    assert program.bootstrap(np.array([1.0, 2, 9]), [np.arange(3)], "median")[0] == 2


def test_the_scatter_takes_its_median_anew_in_every_draw() -> None:
    # Two groups without any scatter inside: where a draw has one group alone nothing is left, however far the groups are apart.
    random = np.random.default_rng(3)
    for _ in range(10):
        apart = random.uniform(1, 30)
        _, low, _ = program.bootstrap(np.repeat([0, apart], 10), [np.repeat(np.arange(2), 10)], "scatter", draws=200)
        assert low == 0
    for _ in range(10):
        values, groups = random.normal(random.uniform(-50, 50), 3, 400), [np.arange(400)]
        scatter = program.bootstrap(values, groups, "scatter", draws=300)
        shifted = program.bootstrap(values + 17, groups, "scatter", draws=300)
        assert shifted == pytest.approx(scatter)
        # Of a normal distribution 0.6745 of its deviation, with a standard error of 1.17 times the deviation over the root of the count.
        assert scatter[0] == pytest.approx(0.6745 * 3, abs=3.5 * 1.17 * 3 / 20)
        assert scatter[1] < scatter[0] < scatter[2]


def test_missing_packages_are_found_first() -> None:
    program.require("numpy", "json")
    with pytest.raises(ModuleNotFoundError) as found:
        program.require("numpy", "no_such_package_of_earshot")
    assert found.value.name == "no_such_package_of_earshot"


def test_the_colour_of_a_chain_is_found() -> None:
    random = np.random.default_rng(9)
    decay = np.exp(-np.arange(6000) / 800)
    for _ in range(10):
        made = [(decay * random.standard_normal(6000)).astype(np.float32) for _ in range(5)]
        tilt_db, centres = random.uniform(-8, 8), rooms.third_octave_levels_db(made[0])[0]
        hz = np.fft.rfftfreq(12000, 1 / rooms.RATE_HZ)
        gain = 10 ** (tilt_db * np.log2(np.maximum(hz, 20) / 1000) / 2 / 20)
        measured = [np.fft.irfft(np.fft.rfft(samples, 12000) * gain, 12000)[:6000] for samples in made]
        found = rooms.third_octave_levels_db(rooms.chain_of(measured, made))[1]
        bandwidth_db = 10 * np.log10(centres)  # of third octaves
        inside = (centres > 200) & (centres < 5000)
        slope = np.polyfit(np.log2(centres[inside]), (found - bandwidth_db)[inside], 1)[0]
        # The same responses on both sides: what is left is the width of the bands.
        assert slope == pytest.approx(tilt_db / 2, abs=0.3)


def test_silence_and_level_have_no_part_in_the_cepstral_distance() -> None:
    random = np.random.default_rng(10)
    for _ in range(10):
        samples = np.concatenate([0.1 * random.standard_normal(8000), np.zeros(8000)])
        louder = random.uniform(0.2, 5) * samples + np.concatenate([np.zeros(8000), 1e-5 * random.standard_normal(8000)])
        assert rooms.cepstral_distance_db(samples, louder) < 0.2
        assert rooms.cepstral_distance_db(samples, np.convolve(louder, [1, -0.9])[:16000]) > 3
