# SPDX-License-Identifier: Apache-2.0
"""Modules in the place of habitat_sim, magnum and corrade: they can be imported, and nothing else."""

from __future__ import annotations

import importlib.abc
import importlib.util
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

NAMES = ("habitat_sim", "magnum", "corrade")
#: Not there for a program that does without them: Habitat-Lab would call them in every step.
LEFT_OUT = frozenset({"habitat_sim.utils.profiling_utils"})

_imports_under_way = 0


class _StandIn(type):
    """A class that stands for one of a missing package.

    Attributes are further stand-ins.  While habitat is imported it can be called, as the default values of some of its functions do;
    afterwards a call says what is missing.
    """

    def __getattr__(cls, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        made = _stand_in(f"{cls.__qualname__}.{name}", cls.__module__)
        setattr(cls, name, made)
        return made

    def __call__(cls, *arguments: Any, **keywords: Any) -> Any:
        if not _imports_under_way:
            missing = next((base for base in cls.__mro__ if base.__module__.split(".")[0] in NAMES), cls)
            package = missing.__module__.split(".")[0]
            raise ImportError(
                f"{missing.__module__}.{missing.__qualname__}: {package} is not installed, and Earshot replaces no part of it"
            )
        return object.__new__(cls)  # type: ignore[arg-type]

    def __or__(cls, other: Any) -> Any:
        return Any

    __ror__ = __or__


def _stand_in(name: str, module: str) -> type:
    return _StandIn(name.split(".")[-1], (), {"__module__": module, "__qualname__": name})


class _Module(ModuleType):
    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or f"{self.__name__}.{name}" in LEFT_OUT:
            raise AttributeError(name)
        made = _stand_in(name, self.__name__)
        setattr(self, name, made)
        return made


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        return ModuleSpec(name, self, is_package=True) if name.split(".")[0] in NAMES and name not in LEFT_OUT else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return _Module(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        pass


@contextmanager
def installed() -> Iterator[None]:
    """Puts stand-ins in the place of the packages that cannot be imported; they stay.  Within the context they can be called."""
    global _imports_under_way
    missing = [name for name in NAMES if name not in sys.modules and importlib.util.find_spec(name) is None]
    if missing and not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        for name in [name for name in sys.modules if name.split(".")[0] == "habitat"]:
            del sys.modules[name]  # of an import that failed for the missing packages
        sys.meta_path.append(_Finder())  # last: packages that are there come first
    _imports_under_way += 1
    try:
        yield
    finally:
        _imports_under_way -= 1
