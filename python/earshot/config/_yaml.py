# SPDX-License-Identifier: Apache-2.0
"""Configs as YAML, for the program."""

from __future__ import annotations

import json
import re
from typing import Any

from .._configs import Config, plain_config

_PLAIN_KEY = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_WORDS = ("on", "off", "yes", "no", "y", "n", "true", "false", "null")  # bools and nothing, in one version of YAML or another


def to_yaml(config: Config) -> str:
    """The YAML of a dataclass, a mapping or an OmegaConf structure, as ``earshot train`` reads it.

    Raises TypeError or InputError, as :func:`earshot.make_vec` does, for values that a config cannot have.
    """
    return _block(plain_config(config, "to_yaml"), "") or "{}\n"


def _block(section: dict[str, Any], indent: str) -> str:
    return "".join(f"{indent}{_key(key)}:{_value(value, indent)}" for key, value in section.items())


def _key(key: str) -> str:
    return key if _PLAIN_KEY.fullmatch(key) and key.lower() not in _WORDS else json.dumps(key)


def _value(value: Any, indent: str) -> str:
    """With the end of the line.  JSON is YAML."""
    if isinstance(value, dict) and value:
        return f"\n{_block(value, indent + '  ')}"
    return f" {json.dumps(value, ensure_ascii=False, allow_nan=False)}\n"
