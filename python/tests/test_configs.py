# SPDX-License-Identifier: Apache-2.0
"""Configs as mappings, dataclasses and OmegaConf structures give the batch of the plain dict."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

import earshot

Make = Callable[..., dict[str, Any]]


@dataclasses.dataclass
class Task:
    max_steps: int = 12
    step_reward: float | None = None  # None: the default of Earshot


@dataclasses.dataclass
class Env:
    episodes: Any
    observation: Any
    acoustics: Any
    seed: Any = dataclasses.field(default_factory=lambda: np.int64(3))
    task: Task = dataclasses.field(default_factory=Task)
    threads: int = 2


def text(config: Any) -> str:
    envs = earshot.make_vec(config, 1)
    return envs.batch.config_text


def test_dataclasses_and_mappings_are_configs(small: Make, tmp_path: Path) -> None:
    config = small()
    expected = text(config)
    assert text(MappingProxyType(config)) == expected
    assert text(Env(config["episodes"], MappingProxyType(config["observation"]), config["acoustics"])) == expected
    config["quarantine_dir"] = tmp_path / "quarantine"
    assert f"quarantine_dir: {tmp_path}" in text(config)


@pytest.mark.parametrize("config", [None, 3, ["a"], Env])
def test_other_things_are_no_configs(config: Any) -> None:
    with pytest.raises(TypeError, match=r"make_vec: config is .*; give a file name, a mapping or an instance of a dataclass"):
        earshot.make_vec(config)


def test_arrays_and_numbers_of_numpy_are_values(small: Make) -> None:
    config = small()
    config["episodes"]["scenes"] = np.array(config["episodes"]["scenes"])
    config["task"] = {"max_steps": np.array(12), "step_reward": np.float32(0.5)}
    assert text(config) == text(small(task={"max_steps": 12, "step_reward": 0.5}))


def test_errors_of_values_name_function_and_argument() -> None:
    circle: dict[str, Any] = {}
    circle["env"] = [circle]
    cases: list[tuple[dict[Any, Any], type[Exception], str]] = [
        (circle, earshot.InputError, "config contains itself"),
        ({"seed": [np.float64("inf")]}, earshot.InputError, "config has a value that is not finite"),
        ({"seed": {1, 2}}, TypeError, "config has a value of type set"),
        ({"seed": b"x"}, TypeError, "config has a value b'x'"),
        ({"seed": 1j}, TypeError, "config has a value of type complex"),
        ({"seed": np.datetime64(1, "s")}, TypeError, "config has a value 1970"),
        ({None: 1}, TypeError, "config has the key None"),
        ({"task": {(1, 2): 1}}, TypeError, "config has the key of type tuple"),
    ]
    calls: dict[str, Callable[[Any], Any]] = {"make": earshot.make, "make_vec": earshot.make_vec, "parallel_env": earshot.parallel_env}
    for function, call in calls.items():
        for config, error, words in cases:
            with pytest.raises(error, match=f"^{function}: {words}") as caught:
                call(config)
            assert "\n" not in str(caught.value)


def test_a_config_is_read_once(small: Make, tmp_path: Path) -> None:
    """As a pipe can be: <(command) of a shell."""
    import json
    import os
    import threading

    for call in (lambda path: earshot.make(path, render_mode="rgb_array"), earshot.make_vec, earshot.parallel_env):
        pipe = tmp_path / "pipe"
        os.mkfifo(pipe)
        writer = threading.Thread(target=pipe.write_text, args=(json.dumps(small()),), daemon=True)
        writer.start()
        call(pipe)
        writer.join(60)
        pipe.unlink()


def test_omegaconf_structures_are_configs(small: Make) -> None:
    omegaconf = pytest.importorskip("omegaconf", reason="no omegaconf")
    config = small()
    made = omegaconf.OmegaConf.create({"steps": 12, "env": {**config, "task": {"max_steps": "${steps}"}}})
    assert text(made.env) == text(config)
