# SPDX-License-Identifier: Apache-2.0
"""The dataclasses of earshot.config are the engine's keys, and give the batch of the plain dict."""

from __future__ import annotations

import copy
import dataclasses
import os
import pickle
import random
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_type_hints

import pytest

import earshot
from earshot import config as classes
from earshot._section import key_of

Make = Callable[..., dict[str, Any]]
CHANGES: dict[str, Any] = {  # values that no default has
    "task.max_steps": 17,
    "order": "once",
    "task.success_radius_m": 0.75,
    "task.actuation_noise.turn_deg": 2.5,
    "acoustics.preset": "high",
    "acoustics.rays": 64,  # the default without a preset
    "acoustics.field": "off",
    "acoustics.rir_length_s": 0.3,
    "observation.rgb": True,
    "observation.depth": False,
    "observation.camera.width_px": 24,
    "observation.cameras": {"left": {"depth": True, "yaw_deg": 90.0}},
    "navmesh.cell_size_m": 0.06,
    "episodes.filter.max_geodesic_m": 20.0,
    "episodes.episodes_per_scene": 3,
    "sound_gain": 2.0,
    "autoreset": "same_step",
    "seed": 9,
}
ROOM = "shoebox:8x3x6"
FILTER: dict[str, Any] = {"min_geodesic_m": 1.0, "min_ratio": 0.0}
EPISODES: dict[str, Any] = {"scenes": [ROOM], "sounds": ["synth:telephone"], "episodes_per_scene": 2, "filter": FILTER}


def effective(config: Any) -> str:
    return earshot.make_vec(config, 1).batch.config_text


def values_of(text: str) -> dict[str, str]:
    """The dotted keys of the engine's YAML, which has a key on each line."""
    found: dict[str, str] = {}
    path: list[str] = []
    for line in text.splitlines():
        key, _, value = line.strip().partition(":")
        path[(len(line) - len(line.lstrip())) // 2 :] = [key]
        if value and not key.startswith("{"):
            found[".".join(path)] = value.strip().strip('"')
    return found


def put(section: Any, key: str, value: Any) -> None:
    """The value of a dotted key of a dataclass."""
    *path, last = key.split(".")
    for part in path:
        section = getattr(section, part)
    if last == "cameras":
        value = {name: classes.MountedCamera(**keys) for name, keys in value.items()}
    setattr(section, last, value)


def nested(values: dict[str, Any]) -> dict[str, Any]:
    config: dict[str, Any] = {"episodes": copy.deepcopy(EPISODES)}
    for key, value in values.items():
        *path, last = key.split(".")
        section = config
        for part in path:
            section = section.setdefault(part, {})
        section[last] = value
    return config


def config_of(values: dict[str, Any]) -> classes.EnvConfig:
    config = classes.EnvConfig(episodes=classes.Episodes(**{**EPISODES, "filter": classes.Filter(**FILTER)}))
    for key, value in values.items():
        put(config, key, value)
    return config


#: Keys that a config records only where they differ from the default, so that its hash does not depend on them.
RECORDED_WHERE_OTHER = {"acoustics.low_octave": True, "acoustics.wall_power": "off", "acoustics.direct_rays": 16}


def test_the_engine_has_the_keys_and_defaults_of_the_classes() -> None:
    said = values_of(effective(config_of({})))
    other = values_of(effective(config_of(RECORDED_WHERE_OTHER)))
    assert set(other) - set(said) == set(RECORDED_WHERE_OTHER)
    seen = set()

    def check(section: Any, path: str) -> None:
        for field in dataclasses.fields(section):
            key, value = path + key_of(field.name), getattr(section, field.name)
            if dataclasses.is_dataclass(value):
                check(value, f"{key}.")
            elif key.split(".")[0] not in ("schema_version", "episodes"):
                seen.add(key)
                if isinstance(value, bool):
                    assert said[key] == str(value).lower(), key
                elif isinstance(value, (int, float)):
                    assert float(said[key]) == pytest.approx(value, rel=1e-6), key
                elif value is not None:
                    assert said.get(key, "{}") == (value or said.get(key) if isinstance(value, str) else "{}"), key

    check(classes.EnvConfig(), "")
    assert seen - {"observation.cameras"} == set(other) - {"observation.cameras"}


def test_a_default_that_is_written_is_that_of_a_key_left_out() -> None:
    """In each preset: else a class could not leave out its defaults."""
    written: dict[str, Any] = {}

    def collect(section: Any, path: str) -> None:
        for field in dataclasses.fields(section):
            value = getattr(section, field.name)
            if dataclasses.is_dataclass(value):
                collect(value, f"{path}{key_of(field.name)}.")
            elif value is not None and not path.startswith("episodes.") and field.name not in ("preset", "cameras"):
                written[path + key_of(field.name)] = value

    collect(classes.EnvConfig(), "")
    assert len(written) > 70
    for preset in ("", "high"):
        assert effective(nested({**written, "acoustics.preset": preset})) == effective(nested({"acoustics.preset": preset})), preset


@pytest.mark.parametrize("seed", range(4))
def test_equal_configs_of_every_form(seed: int, tmp_path: Path) -> None:
    keys = random.Random(seed).sample(sorted(CHANGES), 4 * seed + 3)
    values = {key: CHANGES[key] for key in keys}
    expected = effective(nested(values))
    config = config_of(values)
    assert effective(config) == expected
    path = tmp_path / "config.yaml"
    path.write_text(classes.to_yaml(config), encoding="utf-8")
    assert effective(path) == expected
    for other in (copy.deepcopy(config), pickle.loads(pickle.dumps(config)), dataclasses.replace(config, schema_version=1)):
        assert classes.to_yaml(other) == classes.to_yaml(config)


@pytest.mark.parametrize("seed", range(2))
def test_structured_configs_of_omegaconf(seed: int) -> None:
    conf = pytest.importorskip("omegaconf", reason="no omegaconf").OmegaConf
    keys = random.Random(seed).sample(sorted(CHANGES), 9 * seed + 3)
    values = {key: CHANGES[key] for key in keys}
    expected = effective(nested(values))
    assert effective(conf.create(nested(values))) == expected
    structured = conf.merge(conf.structured(classes.EnvConfig), nested(values))
    assert effective(structured) == expected
    for other in (structured, conf.to_object(structured)):
        assert classes.to_yaml(other) == classes.to_yaml(config_of(values))


def test_omegaconf_names_a_key_that_is_unknown_or_missing() -> None:
    omegaconf = pytest.importorskip("omegaconf", reason="no omegaconf")
    config = omegaconf.OmegaConf.structured(classes.EnvConfig)
    with pytest.raises(omegaconf.errors.ConfigKeyError, match="stepz"):
        omegaconf.OmegaConf.merge(config, {"task": {"stepz": 3}})
    for value, words in (("${none.such}", "none.such"), ("???", "Missing mandatory value")):
        broken = omegaconf.OmegaConf.create({**nested({}), "hrtf": value})
        with pytest.raises(earshot.InputError, match=f"^make_vec: config: .*{words}") as caught:
            earshot.make_vec(broken, 1)
        assert "\n" not in str(caught.value)


def test_a_run_config_of_hydra(tmp_path: Path) -> None:
    """As a user has it: the class in the store, a file and the command line over it."""
    pytest.importorskip("hydra", reason="no hydra-core")
    script = tmp_path / "app.py"
    script.write_text(
        "import earshot, hydra\n"
        "from earshot.config import RunConfig\n"
        "from hydra.core.config_store import ConfigStore\n"
        'ConfigStore.instance().store(name="base", node=RunConfig)\n'
        '@hydra.main(version_base=None, config_path=".", config_name="mine")\n'
        "def main(config: RunConfig) -> None:\n"
        "    print(earshot.make_vec(config, 1).batch.config_text)\n"
        "main()\n"
    )
    (tmp_path / "mine.yaml").write_text(
        "defaults: [base, _self_]\nenv: {acoustics: {preset: high}}\n"
        f"data: {{train: {{scenes: ['{ROOM}'], sounds: [synth:telephone], filter: {{min_geodesic_m: 1, min_ratio: 0}}}}}}\n"
    )
    command = [sys.executable, str(script), "env.task.max_steps=33", "ppo.lambda_=0.9", "hydra.run.dir=out"]
    env = {**os.environ, "PYTHONPATH": str(Path(earshot.__file__).parents[1])}
    done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == effective(nested({"task.max_steps": 33, "acoustics.preset": "high"})).strip()


def test_an_unknown_key_is_an_error_with_the_nearest_one() -> None:
    with pytest.raises(TypeError, match=r"^Task has no key max_stepz; did you mean max_steps?"):
        classes.Task(max_stepz=3)  # type: ignore[call-arg]
    config = classes.EnvConfig()
    with pytest.raises(AttributeError, match=r"^Camera has no key widht_px; did you mean width_px?"):
        config.observation.camera.widht_px = 4  # type: ignore[attr-defined]
    with pytest.raises(earshot.InputError, match=r"task.max_stepz: unknown key; did you mean 'max_steps'?"):
        earshot.make_vec(nested({"task.max_stepz": 3}))
    with pytest.raises(TypeError, match=r"^to_yaml: config is 'text'; give a mapping or an instance of a dataclass"):
        classes.to_yaml("text")


def test_settings_of_a_scene() -> None:
    def bands(settings: Any) -> tuple[int, float]:
        scene = earshot.Scene("shoebox:4x3x3", preset="fast", settings=settings)
        return len(scene.bands_hz), scene.rir_length_s

    expected = bands({"bands": 3, "rir_length_s": 0.25})
    assert expected == (3, 0.25)
    assert bands(classes.Acoustics(bands=3, rir_length_s=0.25)) == expected
    conf = pytest.importorskip("omegaconf", reason="no omegaconf").OmegaConf
    assert bands(conf.create({"bands": 3, "rir_length_s": 0.25})) == expected
    assert bands(conf.structured(classes.Acoustics(bands=3, rir_length_s=0.25))) == expected


def test_settings_of_a_scene_choose_its_preset() -> None:
    def rays(settings: Any, preset: str | None = None) -> tuple[Any, ...]:
        scene = earshot.Scene("shoebox:4x3x3", preset=preset, settings=settings)
        copied = pickle.loads(pickle.dumps(scene))
        assert copied._recipe == scene._recipe
        rir = scene.source([1, 1, 1]).render([3, 1, 2], channels="mono")
        return (*scene._recipe[1:3], rir.tobytes())

    short = {"rir_length_s": 0.1}
    expected = {preset: rays(short, preset) for preset in ("fast", "balanced")}
    assert expected["fast"] != expected["balanced"]
    assert rays(short) == rays({**short, "preset": ""}) == expected["balanced"]
    assert rays(classes.Acoustics(rir_length_s=0.1), "fast") == expected["fast"]
    fast = {**short, "preset": "fast"}
    for settings in (fast, classes.Acoustics(preset="fast", rir_length_s=0.1), [f"{key}={value}" for key, value in fast.items()]):
        assert rays(settings) == rays(settings, "fast") == expected["fast"]
        with pytest.raises(earshot.InputError, match=r"^Scene: preset is 'high' and settings\['preset'\] is 'fast'; give one of them$"):
            rays(settings, "high")
    with pytest.raises(earshot.InputError, match=r"^Scene: settings\['preset'\] is 'best'; give one of fast, balanced, high$"):
        rays({"preset": "best"})
    conf = pytest.importorskip("omegaconf", reason="no omegaconf").OmegaConf
    for run in (conf.structured(classes.RunConfig), conf.create({"env": {"acoustics": {}}})):
        run = conf.merge(run, {"env": {"acoustics": fast}})
        assert rays(run.env.acoustics) == expected["fast"]


SWITCHES: list[tuple[Any, str, Any]] = [  # config, key, an instance that has its defaults
    (classes.ResponseCorpusConfig, "randomize", classes.Randomize),
    (classes.ResponseCorpusConfig, "panorama", classes.Panorama),
    (classes.RecordingCorpusConfig, "randomize", classes.Randomize),
    (classes.SceneConfig, "randomize", classes.SceneRandomize),
]


@pytest.mark.parametrize(("kind", "key", "section"), SWITCHES)
def test_a_section_that_switches_something_on_is_written_where_it_is_given(kind: Any, key: str, section: Any) -> None:
    needed: dict[str, Any] = {"mesh": ROOM} if kind is classes.SceneConfig else {}
    head = classes.to_yaml(kind(**needed))
    assert key not in head
    on = kind(**needed, **{key: section()})
    assert f"{key}: {{}}\n" in classes.to_yaml(on)
    first = dataclasses.fields(section)[0].name
    assert f"{key}:\n  {first}: 77\n" in classes.to_yaml(kind(**needed, **{key: section(**{first: 77})}))
    conf = pytest.importorskip("omegaconf", reason="no omegaconf").OmegaConf
    assert classes.to_yaml(conf.structured(on)) == classes.to_yaml(on)
    assert classes.to_yaml(conf.merge(conf.structured(kind(**needed)), {key: {}})) == classes.to_yaml(on)
    assert classes.to_yaml(conf.structured(kind(**needed))) == head


@pytest.mark.parametrize("values", [{"up": "y"}, {"unit_m": 1.0}, {"coefficients": "energy"}])
def test_what_a_file_decides_is_written_wherever_it_is_given(values: dict[str, Any]) -> None:
    ((key, value),) = values.items()
    assert key not in classes.to_yaml(classes.SceneConfig(mesh=ROOM))
    shown = f'"{value}"' if isinstance(value, str) else value
    assert f"{key}: {shown}\n" in classes.to_yaml(classes.SceneConfig(mesh=ROOM, **values))


def test_the_program_reads_what_to_yaml_writes(tmp_path: Path) -> None:
    program = os.environ.get("EARSHOT_PROGRAM")
    if program is None:
        pytest.skip("no program (EARSHOT_PROGRAM)")
    config = classes.RunConfig(total_steps=100, ppo=classes.Ppo(lambda_=0.9, clip=0.1))
    config.data.train = classes.TrainingEpisodes(scenes=[ROOM], sounds=["synth:telephone"])
    path = tmp_path / "run.yaml"
    path.write_text(classes.to_yaml(config), encoding="utf-8")
    done = subprocess.run([program, "plan", str(path)], capture_output=True, text=True, timeout=300, check=False)
    assert "has no env.accuracy" in done.stderr  # what this command wants; every key is read before
    path.write_text(path.read_text(encoding="utf-8").replace("clip:", "clipp:"), encoding="utf-8")
    done = subprocess.run([program, "plan", str(path)], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 2
    assert "ppo.clipp: unknown key; did you mean 'clip'?" in done.stderr


def test_the_classes_are_made_from_the_keys_of_the_program() -> None:
    program = os.environ.get("EARSHOT_PROGRAM")
    if program is None:
        pytest.skip("no program (EARSHOT_PROGRAM)")
    script = Path(__file__).resolve().parents[2] / "scripts/make_config_classes.py"
    done = subprocess.run([sys.executable, str(script), "--check", program], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout


def test_every_field_has_a_type_that_can_be_read() -> None:
    for name in classes.__all__:
        kind = getattr(classes, name)
        if isinstance(kind, type):
            assert set(get_type_hints(kind)) == {field.name for field in dataclasses.fields(kind)}
