# SPDX-License-Identifier: Apache-2.0
"""Dereverberation and direction of arrival: parts against closed forms, commands through the program."""

import json
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest

soundfile = pytest.importorskip("soundfile")
pytest.importorskip("scipy")
pytest.importorskip("yaml")
torch = pytest.importorskip("torch")

from earshot_asr import dereverb, direction  # noqa: E402


def test_ratio_to_distortion_of_known_noise() -> None:
    random = np.random.default_rng(2)
    for ratio_db in random.uniform(-10, 30, 12):
        target, noise = random.standard_normal((2, 4000))
        noise -= target * np.dot(noise, target) / np.dot(target, target)
        noise *= np.linalg.norm(target) / np.linalg.norm(noise) * 10 ** (-ratio_db / 20)
        assert dereverb.si_sdr_db(random.uniform(0.1, 9) * (target + noise), target) == pytest.approx(ratio_db, abs=1e-6)


def test_the_target_has_what_comes_within_50_ms() -> None:
    random = np.random.default_rng(3)
    dry = random.standard_normal(3000).astype(np.float32)
    for _ in range(10):
        first, early, late = int(random.integers(0, 300)), int(random.integers(1, 399)), int(random.integers(401, 2000))
        response = np.zeros(3000, np.float32)
        response[[first, first + early, first + late]] = 1, 0.6, 0.5
        reverberant, target = dereverb.pair_of(dry, response)
        assert np.allclose((reverberant - target)[first + late :], 0.5 * dry[: len(dry) - first - late], atol=1e-4)
        assert np.allclose((reverberant - target)[: first + late], 0, atol=1e-4)


def test_a_mask_learns_to_leave_reverberation_out() -> None:
    random = np.random.default_rng(4)
    decay = 10 ** (-3 * np.arange(4000) / 4000)

    def pair() -> dereverb.Pair:
        response = (0.2 * decay * random.standard_normal(4000)).astype(np.float32)
        response[0] = 1
        bursts = np.repeat(random.random(16) < 0.3, 1000)
        return dereverb.pair_of((bursts * random.standard_normal(16000)).astype(np.float32) + 1e-5, response)

    network = dereverb.trained([pair() for _ in range(30)], 60, 1, lambda text: None, batch=4)
    gains = [
        dereverb.si_sdr_db(dereverb.masked(network, wet), early) - dereverb.si_sdr_db(wet, early)
        for wet, early in (pair() for _ in range(10))
    ]
    # Three standard errors: a network that has learned nothing lets all through, or half of it.
    assert np.mean(gains) > 3 * np.std(gains) / np.sqrt(10)


def ears(angle_deg: float, random: np.random.Generator, radius_m: float = direction.HEAD_RADIUS_M) -> np.ndarray:
    """White noise at two ears with the delay of a sphere, exact between samples."""
    angle, size = np.radians(angle_deg), round(direction.WINDOW_S * direction.RATE_HZ)
    delay = radius_m / direction.SOUND_SPEED_M_PER_S * (angle + np.sin(angle)) * direction.RATE_HZ
    spectrum = np.fft.rfft(random.standard_normal(size))
    shift = np.exp(-2j * np.pi * np.arange(len(spectrum)) / size * delay)
    return np.stack([np.fft.irfft(spectrum, size), np.fft.irfft(spectrum * shift, size)], axis=1)


def test_the_delay_between_ears_gives_the_angle() -> None:
    random = np.random.default_rng(5)
    for angle_deg in random.uniform(-70, 70, 20):
        # An eighth of a sample is 1.5 degrees at 70.
        assert direction.classical_angle_deg(ears(angle_deg, random)) == pytest.approx(angle_deg, abs=2)


def test_exchanged_features_are_those_of_exchanged_ears() -> None:
    random = np.random.default_rng(6)
    for angle_deg in random.uniform(-90, 90, 10):
        window = ears(angle_deg, random) * random.uniform(0.3, 1, 2)
        features = direction.features_of(window)[None]
        assert np.allclose(direction.exchanged(features)[0], direction.features_of(window[:, ::-1]), atol=1e-4)
        assert not np.allclose(direction.exchanged(features), features, atol=1e-2)


def test_a_network_learns_a_head_of_another_size() -> None:
    random = np.random.default_rng(7)

    def windows(count: int) -> direction.Windows:
        return direction.windows_of(
            [(ears(a, random, 0.06), float(a), "room", str(i)) for i, a in enumerate(random.uniform(-80, 80, count))],
        )

    network = direction.trained(windows(300), 300, 1, lambda text: None)
    tested = windows(50)
    # The classical angle takes a sphere of 8.75 cm: at 40 degrees it is off by 13.
    assert np.median(np.abs(tested.classical_deg - tested.angle_deg)) > 10
    assert np.median(np.abs(direction.estimated_deg(network, tested) - tested.angle_deg)) < 6


@pytest.mark.parametrize(
    ("name", "angle"),
    [
        ("brir_sweep+40", -40),
        ("brir_sweep-80", 80),
        ("sweep0", None),
        ("clap", None),
        ("take10", None),
        ("take2", None),
        ("wing_s1r10", None),
    ],
)
def test_angles_in_names(name: str, angle: float | None) -> None:
    assert direction.measured_angle_deg(pathlib.Path(f"{name}.wav")) == angle


def test_an_angle_without_a_sign_is_0_beside_others(tmp_path: pathlib.Path) -> None:
    for name in ("sweep0", "sweep+40", "take0", "take10", "other+40", "sweep_b0"):
        (tmp_path / f"{name}.wav").touch()
    found = {path.stem: direction.measured_angle_deg(path) for path in tmp_path.glob("*.wav")}
    assert found == {"sweep0": 0, "sweep+40": -40, "take0": None, "take10": None, "other+40": -40, "sweep_b0": None}


@pytest.mark.parametrize(("azimuth", "elevation", "angle"), [(30, 0, 30), (150, 0, 30), (-90, 60, -30), (180, 0, 0), (90, 0, 90)])
def test_angles_from_the_median_plane(azimuth: float, elevation: float, angle: float) -> None:
    assert direction.angle_from_median_plane_deg(azimuth, elevation) == pytest.approx(angle, abs=1e-6)


def test_windows_hold_one_source_at_rest(tmp_path: pathlib.Path) -> None:
    (tmp_path / "00000").mkdir()
    rate = direction.RATE_HZ
    soundfile.write(tmp_path / "00000/000003_r0001.wav", np.random.default_rng(8).standard_normal((4 * rate, 2)), rate, subtype="FLOAT")
    rows = [f"{frame},0,0,30,0,200" for frame in range(2, 14)]  # two windows, and two frames more
    rows += [f"{frame},0,1,{frame},0,200" for frame in range(15, 25)]  # moves
    rows += [f"{frame},0,{source},40,0,200" for frame in range(26, 36) for source in (2, 3)]  # two at once
    (tmp_path / "00000/000003_r0001.csv").write_text("\n".join(rows) + "\n")
    found = direction.recorded_windows(tmp_path)
    assert [(angle, room, clip) for _, angle, room, clip in found] == [(pytest.approx(30), "000003", "000003_r0001 0")] * 2
    assert all(samples.shape == (8000, 2) for samples, *_ in found)


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["dereverb", "--rows", "nothing"], "is none of"),
        (["dereverb", "--steps", "0"], "at least 1"),
        (["dereverb", "--data", "/nowhere"], "no such folder"),
        (["direction", "--rooms", "2"], "at least 5"),
        (["direction", "--steps", "0"], "at least 1"),
        (["direction", "--measured", "/nowhere"], "no such folder"),
        (["rooms", "--synthesized", "-1"], "at least 0"),
    ],
)
def test_wrong_options_end_with_one_line(arguments: list[str], part: str, tmp_path: pathlib.Path) -> None:
    command = [sys.executable, "-m", "earshot_asr", *arguments, "--out", str(tmp_path / "out"), "--earshot", sys.executable]
    done = subprocess.run(command, capture_output=True, text=True, cwd=pathlib.Path(__file__).parent.parent)
    assert done.returncode == 2, done.stderr
    assert part in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """Bursts of noise as digits, and measured responses of noise that decays."""
    folder, random = tmp_path_factory.mktemp("data"), np.random.default_rng(11)
    (folder / "speech/fsdd").mkdir(parents=True)
    for digit in range(10):
        for take in (1, 7):
            soundfile.write(folder / f"speech/fsdd/{digit}_one_{take}.wav", 0.1 * random.standard_normal(3000), 8000)
    for part in ("train", "test"):
        for room in ("a", "b"):
            (folder / "rir_measured" / part / room).mkdir(parents=True)
            decay = 10 ** (-3 * np.arange(8000) / 4000) * random.standard_normal(8000) * 0.05
            decay[:20], decay[20] = 0, 1
            soundfile.write(folder / "rir_measured" / part / room / "r.wav", decay, 8000, subtype="FLOAT")
    for turned in ("+40", "-40"):
        ear = np.zeros((800, 2))
        ear[[20, 34], [1, 0]] = 0.9  # the right ear is first
        soundfile.write(folder / f"rir_measured/test/two{turned}.wav", ear if turned == "+40" else ear[:, ::-1], 44100, subtype="FLOAT")
    return folder


def run_command(arguments: list[str]) -> None:
    root = pathlib.Path(__file__).parents[3]
    path = os.pathsep.join([str(root / "python/earshot_asr"), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-m", "earshot_asr", *arguments], capture_output=True, text=True, cwd=root, env=os.environ | {"PYTHONPATH": path}
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.skipif("EARSHOT_PROGRAM" not in os.environ, reason="needs EARSHOT_PROGRAM")
def test_both_commands_through_the_program(data: pathlib.Path, tmp_path: pathlib.Path) -> None:
    common = ["--data", str(data), "--out", str(tmp_path), "--earshot", os.environ["EARSHOT_PROGRAM"]]
    small = ["dereverb", *common, "--rows", "earshot,measured"]
    small += ["--rooms", "2", "--utterances", "8", "--test-utterances", "2", "--steps", "3"]
    run_command(small)
    first = json.loads((tmp_path / "dereverb.json").read_text())
    assert first["measured_rooms"] is True
    assert set(first["rows"]) == {"earshot", "measured"}
    run_command(small)  # reads what is there
    again = json.loads((tmp_path / "dereverb.json").read_text())
    assert again["rows"] == first["rows"]
    run_command(["direction", *common, "--rooms", "5", "--steps", "20"])
    rows = json.loads((tmp_path / "direction.json").read_text())["rows"]
    assert [row["name"] for row in rows] == ["simulated rooms", "measured responses"]
    # 14 of 44,100 samples are 0.32 ms, 36 degrees of the sphere.
    assert rows[1]["classical"]["by_place"] == {"two+40": pytest.approx(-36, abs=3), "two-40": pytest.approx(36, abs=3)}
