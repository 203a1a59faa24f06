# SPDX-License-Identifier: Apache-2.0
"""Configs of a batch as text: files, mappings, and those that the package brings."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import sys
from collections.abc import Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from . import _arguments as check
from ._engine import InputError
from ._section import defaults_of, is_section, key_of

Config = Any  #: a path or name (str, Path), a mapping (dict, OmegaConf's DictConfig), or an instance of a dataclass

PREFIX = "earshot:"  #: of a config that the package brings: "earshot:train/quick"
FOLDER = Path(__file__).parent / "configs"


def config_text(config: Config, function: str) -> tuple[str, str]:
    """The YAML or JSON of a config, and the name that messages call it by.  function: its name in errors."""
    if isinstance(config, Mapping) or _is_dataclass(config):
        return json.dumps(plain_config(config, function), allow_nan=False), "config"
    if not isinstance(config, (str, os.PathLike)):
        raise TypeError(f"{function}: config is {check.shown(config)}; give a file name, a mapping or an instance of a dataclass")
    name = check.path(config, function, "config")
    path = _packaged(name, function) if name.startswith(PREFIX) else Path(name)
    try:
        return path.read_text(encoding="utf-8"), str(path)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{function}: config {path} cannot be read ({error}); name a YAML file") from error


def packaged_configs() -> list[str]:
    """Names of the configs that the package brings, such as "earshot:train/quick"."""
    return sorted(f"{PREFIX}{path.relative_to(FOLDER).with_suffix('')}" for path in FOLDER.glob("*/*.yaml"))


def key_value(text: str, overrides: Sequence[str], key: str) -> str | None:
    """The plain value that a config gives to a key, wherever it stands in it; None: the key does not occur.  Keys that occur once alone."""
    found: str | None = None
    for line in text.splitlines():
        for value in re.findall(rf"(?<![\w.]){key}[\"']?\s*:\s*[\"']?([\w.+-]+)", _without_comment(line)):
            found = value
    for override in overrides:
        name, _, value = override.partition("=")
        if name.strip().split(".")[-1] == key:
            found = value.strip().strip("\"'")
    return found


def is_on(text: str, overrides: Sequence[str], key: str, default: bool = False) -> bool:
    value = key_value(text, overrides, key)
    return default if value is None else value.lower() in ("true", "on", "yes")


def plain_config(config: Any, function: str) -> dict[str, Any]:
    """A mapping or an instance of a dataclass as dicts, lists, texts and finite numbers."""
    if not isinstance(config, Mapping) and not _is_dataclass(config):
        raise TypeError(f"{function}: config is {check.shown(config)}; give a mapping or an instance of a dataclass")
    try:
        plain: dict[str, Any] = _plain(config, function)
        json.dumps(plain, allow_nan=False)
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{function}: config has a value that is not finite") from None
    except RecursionError:
        raise InputError(f"{function}: config contains itself or is nested too deeply") from None
    return plain


def plain_settings(settings: Any, function: str) -> Any:
    """Dicts of OmegaConf's structures and of dataclasses; anything else as it is."""
    return plain_config(settings, function) if _is_dataclass(settings) or _is_omegaconf(settings) else settings


def _plain(value: Any, function: str) -> Any:
    """Dicts, lists and numbers out of mappings, sequences, dataclasses, paths, and arrays of numpy; None of a dataclass is left out."""
    if isinstance(value, Enum):
        return _plain(value.value, function)
    if value is None or isinstance(value, (str, bool, int, float)):
        return value
    if isinstance(value, (np.generic, np.ndarray)) and value.dtype.kind in "biufUO":
        return _plain(value.tolist(), function)
    if _is_dataclass(value):
        return _fields({field.name: getattr(value, field.name) for field in dataclasses.fields(value)}, type(value), function)
    if isinstance(value, Mapping):
        kind = sys.modules["omegaconf"].OmegaConf.get_type(value) if _is_omegaconf(value) else None
        if dataclasses.is_dataclass(kind) and isinstance(kind, type):
            return _fields(dict(_items(value, function)), kind, function)
        return {_key(key, function): _plain(one, function) for key, one in _items(value, function)}
    if isinstance(value, Sequence) and not isinstance(value, (bytes, bytearray, memoryview)):
        return [_plain(one, function) for one in value]
    if isinstance(value, os.PathLike):
        return check.path(value, function, "a path in config")
    raise TypeError(f"{function}: config has a value {check.shown(value)}; give numbers, texts, bools, lists and dicts")


def _fields(values: dict[str, Any], kind: type, function: str) -> dict[str, Any]:
    """Of a dataclass.  Of a section of earshot.config what differs from its defaults, so that other keys decide what it leaves to them."""
    plain = {name: _plain(value, function) for name, value in values.items() if value is not None}
    if not is_section(kind):
        return plain
    defaults = {name: json.dumps(_plain(value, function)) for name, value in defaults_of(kind).items()}
    return {key_of(name): value for name, value in plain.items() if json.dumps(value) != defaults.get(name)}


def _items(mapping: Mapping[Any, Any], function: str) -> list[tuple[Any, Any]]:
    try:
        return list(mapping.items())
    except Exception as error:
        if not type(error).__module__.startswith("omegaconf"):
            raise
        raise InputError(f"{function}: config: {str(error).splitlines()[0]}") from error  # an interpolation, or a value that is missing


def _is_omegaconf(value: object) -> bool:
    module = sys.modules.get("omegaconf")
    return module is not None and isinstance(value, module.DictConfig)


def _key(key: object, function: str) -> str:
    if isinstance(key, Enum):
        return _key(key.value, function)
    if isinstance(key, (str, int, float)):
        return str(key)
    raise TypeError(f"{function}: config has the key {check.shown(key)}; give texts as keys")


def _is_dataclass(value: object) -> bool:
    return dataclasses.is_dataclass(value) and not isinstance(value, type)


def _without_comment(line: str) -> str:
    """YAML begins a comment with # at the start of a line or after white space."""
    return re.split(r"(?:^|\s)#", line, maxsplit=1)[0]


def _packaged(name: str, function: str) -> Path:
    if name not in packaged_configs():
        raise InputError(f"{function}: config {name}: the package has no such config; it has {', '.join(packaged_configs())}")
    return (FOLDER / name.removeprefix(PREFIX)).with_suffix(".yaml")
