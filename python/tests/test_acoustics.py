# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import concurrent.futures
import math
import pickle
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import earshot

ROOM = "shoebox:6x3x5"


@pytest.fixture(scope="module")
def scene() -> earshot.Scene:
    return earshot.Scene(ROOM, preset="fast", settings={"rir_length_s": 0.3})


def test_first_response_in_three_lines() -> None:
    scene = earshot.Scene("house:7", preset="fast", settings={"rir_length_s": 0.2})
    source, listener = scene.random_positions(2, seed=1)
    rir = scene.source(source).render(listener, channels="binaural")
    assert rir.shape == (2, round(0.2 * scene.sample_rate_hz))
    assert rir.dtype == np.float32
    assert np.isfinite(rir).all()
    assert np.abs(rir).max() > 0


def test_direct_sound_is_the_green_function(scene: earshot.Scene) -> None:
    response = scene.source([2, 1.5, 2]).response([4, 1.5, 2])
    direct = response.arrivals
    assert direct.kind_names[0] == "direct"
    # Pressure 1 / (4 pi r) of a unit source; air absorbs less than 2 % over 2 m below 8 kHz.
    assert direct.amplitude[0, 0] == pytest.approx(1 / (4 * math.pi * 2), rel=0.02)
    assert direct.delay_s[0] == pytest.approx(2 / response.speed_of_sound_m_per_s, rel=1e-5)
    assert np.allclose(direct.direction[0], [-1, 0, 0], atol=1e-5)
    assert np.all(np.diff(direct.distance_m) >= 0)
    assert direct.amplitude.shape == (len(direct), len(scene.bands_hz))


def test_impulse_comes_at_its_time(scene: earshot.Scene) -> None:
    rir = scene.source([2, 1.5, 2]).render([4, 1.5, 2], channels="mono")
    assert rir.shape[0] == 1
    first = int(np.argmax(np.abs(rir[0]) > 0.5 * np.abs(rir[0]).max()))
    expected = 2 / 343.2 * scene.sample_rate_hz
    assert abs(first - expected) < 3


@pytest.mark.parametrize(
    ("channels", "count"),
    [
        ("mono", 1),
        ("stereo", 2),
        ("stereo:ab", 2),
        ("binaural", 2),
        ("quad", 4),
        ("surround_5_1", 6),
        ("surround_7_1", 8),
        ("ambisonic:1", 4),
        ("ambisonic:2", 9),
    ],
)
def test_channels(scene: earshot.Scene, channels: str, count: int) -> None:
    rir = scene.source([2, 1.5, 2]).render([4, 1.5, 3], channels=channels)
    assert rir.shape == (count, round(0.3 * scene.sample_rate_hz))
    assert np.isfinite(rir).all()


def test_cardioids_face_their_loudspeakers() -> None:
    room = earshot.Scene("shoebox:90x90x90@1", preset="fast", settings={"early": "off", "late": "off", "diffraction": "off"})
    azimuths: dict[str, list[int | None]] = {"stereo": [45, -45], "quad": [30, -30, 95, -95], "surround_5_1": [30, -30, 0, None, 110, -110]}
    azimuths["surround_7_1"] = [30, -30, 0, None, 135, -135, 90, -90]
    for angle in np.random.default_rng(7).uniform(-180, 180, 5):  # of the source, to the left of the listener's front
        turn = np.deg2rad(angle)
        source = room.source([45 - 30 * np.sin(turn), 45, 45 - 30 * np.cos(turn)])
        mono = source.render([45, 45, 45], channels="mono")[0]
        for name, speakers in azimuths.items():
            heard = source.render([45, 45, 45], channels=name)
            for channel, azimuth in zip(heard, speakers, strict=True):
                if azimuth is not None:
                    gain = channel @ mono / (mono @ mono)
                    assert abs(gain - (0.5 + 0.5 * np.cos(turn - np.deg2rad(azimuth)))) < 1e-3


def test_environments_have_the_channels_of_their_config() -> None:
    room = {"scenes": ["shoebox:6x3x5@0.3"], "sounds": ["synth:noise"], "filter": {"min_geodesic_m": 1, "min_ratio": 0}}
    config = {"episodes": room}
    for name, count in (("mono", 1), ("quad", 4), ("surround_7_1", 8)):
        sensors = {"observation": {"channels": name, "waveform": True}, "acoustics": {"rays": 8, "rir_length_s": 0.1}}
        envs = earshot.make_vec({**config, **sensors}, num_envs=1)
        shown, _ = envs.reset(seed=3)
        assert shown["spectrogram"].shape == (1, 65, 26, count)
        assert shown["waveform"].shape[:2] == (1, count)
        assert np.all(np.abs(shown["waveform"]).sum(axis=2) > 0)
        envs.close()


def test_left_ear_is_louder_for_a_source_on_the_left(scene: earshot.Scene) -> None:
    rir = scene.source([2, 1.5, 2]).render([4, 1.5, 2])  # facing -z, the source at -x
    energy = (rir**2).sum(axis=1)
    assert energy[0] > 1.2 * energy[1]
    turned = (scene.source([2, 1.5, 2]).render([4, 1.5, 2], 180) ** 2).sum(axis=1)
    assert turned[1] > 1.2 * turned[0]


def test_a_batch_has_the_bits_of_single_calls_for_any_number_of_threads(scene: earshot.Scene) -> None:
    listeners = scene.random_positions(7, seed=4)
    headings = np.linspace(0, 300, 7)
    source = scene.source([2, 1.5, 2], pattern="cardioid", heading_deg=30)
    one = source.render(listeners, headings, threads=1)
    assert one.shape[:2] == (7, 2)
    assert np.array_equal(one, source.render(listeners, headings, threads=4))
    singles = [source.render(place, heading) for place, heading in zip(listeners, headings, strict=True)]
    assert np.array_equal(one, np.stack(singles))
    again = earshot.Scene(ROOM, preset="fast", settings={"rir_length_s": 0.3})
    assert np.array_equal(one, again.source([2, 1.5, 2], pattern="cardioid", heading_deg=30).render(listeners, headings))


def test_another_seed_gives_other_bits(scene: earshot.Scene) -> None:
    other = earshot.Scene(ROOM, preset="fast", settings={"rir_length_s": 0.3}, seed=99)
    listener = [4, 1.5, 3]
    assert not np.array_equal(scene.source([2, 1.5, 2]).render(listener), other.source([2, 1.5, 2]).render(listener))


def test_response_renders_what_the_source_renders(scene: earshot.Scene) -> None:
    source = scene.source([2, 1.5, 2])
    response = source.response([4, 1.5, 3])
    assert np.array_equal(response.render(90), source.render([4, 1.5, 3], 90))
    assert response.late.ndim == 3
    assert not response.late.flags.writeable
    assert (response.late[..., 0] >= 0).all()
    late = response.late
    del response, source
    assert np.isfinite(late).all()  # the array keeps its memory


def test_metrics_of_energy_and_of_the_rir_agree() -> None:
    scene = earshot.Scene("shoebox:7x3x6@0.2", preset="balanced", settings={"rir_length_s": 1.0})
    response = scene.source([2, 1.1, 2.3]).response([5, 1.7, 4.1])  # off the middles, where paths of equal length would add in phase
    energy = response.metrics
    assert energy.bands_hz.tolist() == scene.bands_hz.tolist()
    # Sabine: 0.161 V / (a S) = 0.63 s with S = 162 m2; Eyring 0.56 s.  Wide enough for the air's part, which only shortens.
    middle = int(np.argmin(np.abs(energy.bands_hz - 1000)))
    assert 0.4 < energy.t20_s[middle] < 0.8
    measured = earshot.measure(response.render(channels="mono"), scene.sample_rate_hz, direct_delay_s=energy.direct_delay_s)
    assert measured.bands_hz[1:].tolist() == energy.bands_hz.tolist()  # samples are measured from 63 Hz up
    assert measured.t20_s[middle + 1] == pytest.approx(energy.t20_s[middle], rel=0.1)
    assert measured.c50_db[middle + 1] == pytest.approx(energy.c50_db[middle], abs=1.5)


def test_measure_finds_the_direct_sound() -> None:
    random = np.random.default_rng(38)
    for _ in range(10):
        onset, t60_s = int(random.integers(200, 6000)), random.uniform(0.3, 0.8)
        samples = 3e-4 * random.standard_normal(24000)  # the noise of a recording
        tail = np.arange(24000 - onset - 60)
        samples[onset + 60 :] += 0.05 * random.standard_normal(len(tail)) * 10 ** (-3 * tail / 16000 / t60_s)
        samples[onset] += 1
        near = np.abs(np.arange(24000) - onset) < 40
        expected_db = 10 * np.log10(np.sum(samples[near] ** 2) / np.sum(samples[~near] ** 2))
        found = earshot.measure(samples, 16000)
        assert found.direct_delay_s == pytest.approx(onset / 16000, abs=1e-9)
        assert found.drr_db == pytest.approx(expected_db, abs=0.05)
        assert set(found.missing) == {"g_db"}
        assert np.isnan(found.g_db).all()
        assert not np.isnan(earshot.measure(samples, 16000, green_units=True).g_db).any()
        assert np.isnan(found.sti)


def test_parameters_on_request_of_samples() -> None:
    pair = np.zeros((2, 16000))
    pair[0, 1600], pair[0, 2400], pair[1, 2400] = 1, 0.5, 0.3
    found = earshot.measure(pair[0], 16000, parameters=["lateral", "speech"], lateral=pair[1], green_units=True)
    assert found.j_lf[4] == pytest.approx(0.09 / 1.25, abs=0.002)
    assert found.j_lfc[4] == pytest.approx(0.15 / 1.25, abs=0.004)
    assert 0.6 < found.sti <= 1
    noisy = earshot.measure(pair[0], 16000, parameters=["speech"], speech_snr_db=0)
    assert noisy.sti < 0.51  # at 0 dB nothing is above a half
    lacking = earshot.measure(pair[0], 16000, parameters=["lateral", "stage"])
    assert np.isnan(lacking.j_lf).all()
    assert set(lacking.missing) == {"g_db", "j_lf", "j_lfc", "lg_db", "st_late_db"}
    assert len(earshot.measure(pair[0], 16000, bands="third_octaves").bands_hz) == 20
    refused: list[tuple[dict[str, Any], str]] = [
        ({"bands": "halves"}, "measure: bands is 'halves'"),
        ({"parameters": ["loud"]}, "parameters: 'loud' is not a group"),
        ({"parameters": ["speech"], "speech_snr_db": [1, 2]}, "speech_snr_db = 2: must be one ratio"),
        ({"parameters": ["lateral"], "lateral": pair}, "measure: lateral has shape (2, 16000)"),
        ({"direct_delay_s": -1}, "measure: direct_delay_s is -1"),
        ({"direct_delay_s": 100}, "direct_delay_s: is 100 s, but the response ends after 1 s"),
        ({"lateral": pair[1]}, "lateral: has no effect without lateral parameters"),
        ({"parameters": ["lateral"], "lateral": pair[0]}, "lateral: is the measured response itself"),
        ({"reference": pair[1], "green_units": True}, "reference: is given together with green_units"),
    ]
    for arguments, words in refused:
        with pytest.raises(earshot.InputError, match=re.escape(words)):
            earshot.measure(pair[0], 16000, **arguments)


def test_parameters_on_request_of_a_response() -> None:
    scene = earshot.Scene("shoebox:8x3x6@0.2", preset="fast", settings={"rir_length_s": 1.2, "sh_order": 4, "rays": 512})
    response = scene.source([2, 1.5, 2]).response([6, 1.6, 4.3])
    assert np.isnan(response.metrics.j_lf).all()
    groups = ["lateral", "speech", "stage", "interaural"]
    found, errors = response.measure(groups), response.standard_errors(groups)
    assert (found.j_lf > 0.05).all()
    assert (found.j_lfc > found.j_lf).all()
    assert set(found.missing) == {"st_early_db", "st_late_db"}
    assert np.array_equal(found.t20_s, response.metrics.t20_s)
    for values in (errors.j_lf, errors.lg_db, errors.mti, errors.t20_s, errors.edt_s, errors.iacc_early, errors.iacc_late):
        assert ((values > 0) & (values < 0.5)).all()
    assert 0 < errors.sti < 0.1
    first_order = earshot.Scene("shoebox:8x3x6@0.2", preset="fast", settings={"rir_length_s": 0.5}).source([2, 1.5, 2])
    assert "sh_order" in first_order.response([6, 1.6, 4.3]).measure(["lateral"]).missing["j_lf"]


def test_plan_says_what_is_simulated(scene: earshot.Scene) -> None:
    plan = {decision.effect: decision for decision in scene.plan}
    assert "transmission" in plan
    assert not plan["transmission"].on  # nothing lies behind the walls of a box
    assert all(decision.why for decision in plan.values())


def test_random_positions_are_inside_and_a_prefix_of_more(scene: earshot.Scene) -> None:
    places = scene.random_positions(20, height_m=1.2, seed=5)
    low, high = scene.bounds
    assert ((places > low) & (places < high)).all()
    assert np.array_equal(places[:5], scene.random_positions(5, height_m=1.2, seed=5))


def test_threads_of_python_render_at_once(scene: earshot.Scene) -> None:
    source = scene.source([2, 1.5, 2])
    listeners = scene.random_positions(6, seed=8)
    with concurrent.futures.ThreadPoolExecutor(3) as pool:
        rirs = list(pool.map(lambda place: source.render(place, threads=1), listeners))
    assert np.array_equal(np.stack(rirs), source.render(listeners, threads=1))


def test_errors_are_python_exceptions_with_one_line(scene: earshot.Scene, tmp_path: Path) -> None:
    assert issubclass(earshot.InputError, ValueError)
    assert issubclass(earshot.RunError, RuntimeError)
    broken = tmp_path / "broken.glb"
    broken.write_bytes(b"glTF no mesh")
    source, place = scene.source([2, 1.5, 2]), [4, 1.5, 2]
    calls: list[tuple[Callable[[], Any], str]] = [
        (lambda: earshot.Scene("house:not_a_seed"), "house:SEED: 'not_a_seed' is not a number"),
        (lambda: earshot.Scene(str(tmp_path / "absent.glb")), f"{tmp_path}/absent.glb: does not exist"),
        (lambda: earshot.Scene(str(broken)), f"{broken}: is not a complete GLB file"),
        (lambda: earshot.Scene(ROOM, settings={"reys": 5}), "settings reys=5: reys: unknown key; did you mean 'rays'?"),
        (lambda: earshot.Scene(ROOM, preset="best"), "Scene: preset is 'best'; give one of fast"),
        (lambda: scene.source([2, 1.5, 2], pattern="cardiod"), "directivity 'cardiod': is not a known pattern"),
        (lambda: scene.source([2, 1.5]), "Scene.source: position has shape (2,)"),
        (lambda: scene.source([2, math.nan, 2]), "Scene.source: position has the value nan"),
        (lambda: source.render([math.inf, 0, 0]), "Source.render: listener has the value inf"),
        (lambda: source.render(place, math.nan), "Source.render: heading_deg has the value nan"),
        (lambda: source.render(place, [1, 2]), "Source.render: heading_deg has shape (2,) for 1 listeners"),
        (lambda: source.render(place, channels="quadraphonic"), "listener 'quadraphonic': is not a known layout"),
        (lambda: source.render(place, channels="mono", hrtf="head.sofa"), "hrtf: has no effect on channels 'mono'"),
        (lambda: source.response(place, channels="mono").render(channels="binaural"), "channels: 'binaural' needs harmonics of order 1"),
        (lambda: earshot.measure(np.zeros((0, 0)), 16000), "measure: rir has shape (0, 0)"),
    ]
    for call, words in calls:
        with pytest.raises(earshot.InputError, match=f"^{re.escape(words)}") as caught:
            call()
        assert "\n" not in str(caught.value)


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    x=st.floats(0.3, 5.7),
    y=st.floats(0.3, 2.7),
    z=st.floats(0.3, 4.7),
    heading=st.floats(-720, 720),
    pitch=st.floats(-90, 90),
)
def test_any_pose_in_the_room_hears_the_direct_sound(
    scene: earshot.Scene, x: float, y: float, z: float, heading: float, pitch: float
) -> None:
    source = scene.source([2, 1.5, 2])
    rir = source.render([x, y, z], heading, pitch_deg=pitch)
    assert np.isfinite(rir).all()
    assert np.abs(rir).max() > 0
    away = np.array([2, 1.5, 2]) - [x, y, z]
    distance = float(np.linalg.norm(away))
    direct = source.response([x, y, z]).arrivals
    assert direct.distance_m[0] == pytest.approx(distance, abs=1e-5)
    if distance > 0.3:  # nearer, a source is no point
        # Pressure 1 / (4 pi r); air absorbs less than 1 % per metre in the lowest band.
        assert direct.amplitude[0, 0] == pytest.approx(1 / (4 * math.pi * distance), rel=0.02 + 0.01 * distance)
        assert np.allclose(direct.direction[0], away / distance, atol=1e-4)


def test_settings_of_an_accuracy_keep_it() -> None:
    room, keys = "shoebox:6x3x5@0.3", {"rir_length_s": 0.5}
    listeners = [[4, 1.5, 2], [3, 1.2, 4], [5, 1.6, 3.5]]
    source = earshot.Scene(room, preset="fast", settings=keys).source([2, 1.5, 2])
    plan = source.plan_accuracy("t20=20%", listeners)
    assert plan.choice in plan.tried
    assert plan.choice.predicted["t20_pct"] <= 20
    assert plan.choice.per_response_ms > 0
    planned = earshot.Scene(room, preset="fast", settings={**keys, **plan.choice.settings})
    assert np.isfinite(planned.source([2, 1.5, 2]).render(listeners[0])).all()
    with pytest.raises(earshot.InputError, match="t20"):
        source.plan_accuracy("t20=5", listeners)
    with pytest.raises(earshot.InputError, match="listeners"):
        source.plan_accuracy("t20=20%", np.empty((0, 3)))


def test_a_place_outside_a_closed_scene_is_refused() -> None:
    generator = np.random.default_rng(7)
    quick = {"rays": 16, "rir_length_s": 0.2, "field": "off"}
    for _ in range(11):
        size = generator.uniform([3, 2.4, 3], [8, 4, 8])
        room = earshot.Scene(f"shoebox:{size[0]:.3f}x{size[1]:.3f}x{size[2]:.3f}@0.3", preset="fast", settings=quick)
        inside = size * generator.uniform(0.1, 0.9, 3)
        outside = size * generator.uniform(0.1, 0.9, 3)
        axis = generator.integers(3)
        outside[axis] = generator.choice([-0.5, 1.5]) * size[axis]
        assert room.source(inside).render(size / 2, channels="mono").any()
        with pytest.raises(earshot.InputError, match=r"listener .* lies outside the scene"):
            room.source(inside).render([size / 2, outside], channels="mono")
        with pytest.raises(earshot.InputError, match=r"source .* lies outside the scene"):
            room.source(outside).response(inside)
    with pytest.warns(UserWarning, match="both lie outside"):
        room.source(size + 1).response(size + 2)
    assert any("both lie outside" in line for line in room.warnings)


def test_what_is_odd_about_a_scene_is_warned_of(tmp_path: Path) -> None:
    corners = [(x, y, z) for z in (0, 3) for y in (0, 4) for x in (0, 5)]  # z up, without a wall
    faces = {"floor": "1 2 4 3", "ceiling": "5 7 8 6", "wall": "1 3 7 5"}
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in corners)
    file = tmp_path / "room.obj"
    file.write_text(text + "".join(f"usemtl {name}\nf {face}\n" for name, face in faces.items()))
    with pytest.warns(UserWarning, match="up axis of the mesh is probably z"):
        scene = earshot.Scene(str(file), preset="fast")
    assert any("up axis" in line for line in scene.warnings)
    with pytest.warns(UserWarning, match="of the rays leave the scene"):
        turned = earshot.Scene(str(file), preset="fast", up="z")
    assert not any("up axis" in line for line in turned.warnings)
    with pytest.raises(earshot.InputError, match="up"):
        earshot.Scene(str(file), up="x")


def test_a_result_follows_from_the_arguments_of_its_call_alone() -> None:
    """A call of 300 listeners takes a source field where that is cheaper.  What calls before took changes no call."""
    settings = {"rir_length_s": 0.1, "rays": 2048, "field_photons": 20_000}
    scene = earshot.Scene("house:1,rooms=3,area_m2=36", preset="fast", settings=settings)
    source_place, *listeners = scene.random_positions(301, seed=3)
    many = np.stack(listeners)
    fresh = scene.source(source_place)
    one, response, few = fresh.render(many[0]), fresh.response(many[0]), fresh.render(many[:9])
    used = scene.source(source_place)
    all_rirs = used.render(many)
    assert not np.array_equal(all_rirs[0], one), "the large call takes no field: the test shows nothing"
    assert np.array_equal(used.render(many[0]), one)
    assert np.array_equal(used.render(many[:9]), few)
    again = used.response(many[0])
    assert np.array_equal(again.late, response.late)
    assert np.array_equal(pickle.loads(pickle.dumps(again)).late, again.late)
    assert np.array_equal(used.render(many), all_rirs)
    whole = used.responses(many)
    assert np.array_equal(pickle.loads(pickle.dumps(whole[7])).late, whole[7].late)


def test_a_finished_field_is_used_while_another_is_built() -> None:
    settings = {"rir_length_s": 0.2, "field": "on", "field_photons": 32_768, "rays": 256}
    scene = earshot.Scene("house:1,rooms=3,area_m2=36", preset="fast", settings=settings)
    place, listener = scene.random_positions(2, seed=3)
    source = scene.source(place)
    expected = source.render(listener, channels="mono")
    with concurrent.futures.ThreadPoolExecutor(1) as pool:
        building = pool.submit(source.render, listener, channels="ambisonic:3")
        begin, longest_s = time.monotonic(), 0.0
        while not building.done():
            asked = time.monotonic()
            assert np.array_equal(source.render(listener, channels="mono"), expected)
            longest_s = max(longest_s, time.monotonic() - asked)
        assert longest_s < 0.5 * (time.monotonic() - begin), "a finished field waits for another"
        built = building.result()
        assert np.array_equal(built, source.render(listener, channels="ambisonic:3"))
