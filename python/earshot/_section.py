# SPDX-License-Identifier: Apache-2.0
"""What the classes of config keys share."""

from __future__ import annotations

import dataclasses
import difflib
import keyword
from typing import TYPE_CHECKING, Any


class Section:
    """A section of a config.  A field that has its default is left out of the config, and so is a section without a value."""

    __slots__ = ()

    def __new__(cls, *_: Any, **keys: Any) -> Any:
        names = [field.name for field in dataclasses.fields(cls)]  # type: ignore[arg-type]
        for key in keys:
            if key not in names:
                raise TypeError(_unknown(cls.__name__, key, names))
        return super().__new__(cls)

    if not TYPE_CHECKING:  # which would take every name as an attribute

        def __setattr__(self, key: str, value: Any) -> None:
            try:
                object.__setattr__(self, key, value)
            except AttributeError:
                names = [field.name for field in dataclasses.fields(self)]
                raise AttributeError(_unknown(type(self).__name__, key, names)) from None


def _unknown(kind: str, key: str, names: list[str]) -> str:
    near = difflib.get_close_matches(key, names, 1)
    return f"{kind} has no key {key}; " + (f"did you mean {near[0]}?" if near else f"it has {', '.join(names)}")


def is_section(kind: object) -> bool:
    return isinstance(kind, type) and issubclass(kind, Section)


def key_of(field: str) -> str:
    """The key of a field: that of `lambda_` is lambda."""
    return field[:-1] if field.endswith("_") and keyword.iskeyword(field[:-1]) else field


def defaults_of(kind: type[Section]) -> dict[str, Any]:
    """The values of a new instance by field; fields without a default are left out."""
    found = {}
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        if field.default is not dataclasses.MISSING:
            found[field.name] = field.default
        elif field.default_factory is not dataclasses.MISSING:
            found[field.name] = field.default_factory()
    return found
