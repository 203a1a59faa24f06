# SPDX-License-Identifier: Apache-2.0
"""Checks of arguments: each error is one line that names the function and the argument."""

from __future__ import annotations

import math
import numbers
import operator
import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._engine import InputError

NUM_ACTIONS = 4  #: stop, forward, left, right
LARGEST_SEED = 2**64 - 1
MOST_THREADS = 1024
FARTHEST_M = 1e9  #: of a coordinate


def shown(value: object) -> str:
    """A short text without line ends."""
    if isinstance(value, np.generic) and not isinstance(value, (str, bytes)):
        return str(value)[:60].replace("\n", " ")
    if isinstance(value, (str, bytes, int, float, type(None))):
        try:
            text = repr(value)
        except ValueError:  # an integer of thousands of digits
            return f"an {type(value).__name__} out of range"
        return text if len(text) <= 60 else text[:57] + "..."
    return f"of type {type(value).__name__}"


def integer(value: object, where: str, name: str, low: int, high: int) -> int:
    """Python's and numpy's integers; no bool."""
    if isinstance(value, (bool, np.bool_, np.ndarray)) or not hasattr(type(value), "__index__"):
        raise TypeError(f"{where}: {name} is {shown(value)}; give an integer")
    found = operator.index(value)  # type: ignore[arg-type]
    if not low <= found <= high:
        raise InputError(f"{where}: {name} is {shown(found)}; give an integer from {low} to {high}")
    return found


def seed(value: object, where: str, name: str = "seed") -> int:
    return integer(value, where, name, 0, LARGEST_SEED)


def threads(value: object, where: str) -> int:
    return integer(value, where, "threads", 0, MOST_THREADS)


def number(value: object, where: str, name: str, low: float = -math.inf, high: float = math.inf, *, above: bool = False) -> float:
    """Finite.  above: more than `low`, not at least."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (numbers.Real, np.floating, np.integer)):
        raise TypeError(f"{where}: {name} is {shown(value)}; give a number")
    try:
        found = float(value)
    except OverflowError:
        found = math.inf
    if not math.isfinite(found):
        raise InputError(f"{where}: {name} is {found}; give a finite number")
    if not (low < found if above else low <= found) or found > high:
        limits = f"{'above' if above else 'of at least'} {low:g}" if math.isinf(high) else f"from {low:g} to {high:g}"
        raise InputError(f"{where}: {name} is {found:g}; give a number {limits}")
    return found


def flag(value: object, where: str, name: str) -> bool:
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{where}: {name} is {shown(value)}; give True or False")
    return bool(value)


def text(value: object, where: str, name: str) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{where}: {name} is {shown(value)}; give a text")
    try:
        value.encode()
    except UnicodeEncodeError:
        raise InputError(f"{where}: {name} is {ascii(value)[:60]}, which is no Unicode text") from None
    if "\0" in value:
        raise InputError(f"{where}: {name} is {shown(value)}, which contains a null character")
    return str(value)


def path(value: object, where: str, name: str) -> str:
    """A text or a path."""
    if isinstance(value, os.PathLike):
        value = os.fspath(value)
    return text(value, where, name)


def one_of(value: object, where: str, name: str, choices: Sequence[str]) -> str:
    found = text(value, where, name)
    if found not in choices:
        raise InputError(f"{where}: {name} is {shown(found)}; give one of {', '.join(choices)}")
    return found


def texts(values: object, where: str, name: str) -> list[str]:
    if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
        raise TypeError(f"{where}: {name} is {shown(values)}; give a list of texts")
    return [text(value, where, f"{name}[{index}]") for index, value in enumerate(values)]


def parameters(groups: object, speech_snr_db: object, where: str) -> tuple[list[str], list[float]]:
    """Groups of room-acoustic parameters, and ratios of speech to noise."""
    names = texts(groups, where, "parameters")
    ratios = floats(speech_snr_db, where, "speech_snr_db")
    if ratios.ndim > 1:
        raise InputError(f"{where}: speech_snr_db has shape {ratios.shape}; give one number or seven")
    return names, ratios.ravel().tolist()


def settings(values: object, where: str) -> list[str]:
    """As "key=value" texts."""
    if not isinstance(values, Mapping):
        found = texts(values, where, "settings")
        for one in found:
            if "=" not in one:
                raise InputError(f"{where}: settings has {shown(one)}; write it as 'key=value'")
        return found
    return [f"{text(key, where, 'a key of settings')}={_setting(value, where, key)}" for key, value in values.items()]


def _setting(value: object, where: str, key: str) -> str:
    if isinstance(value, (bool, np.bool_)):
        return "on" if value else "off"
    if isinstance(value, os.PathLike):
        return path(value, where, f"settings['{key}']")
    if isinstance(value, str):
        return text(value, where, f"settings['{key}']")
    if isinstance(value, (int, float, np.integer, np.floating)):
        if isinstance(value, int) and abs(value) > 2**64:
            raise InputError(f"{where}: settings['{key}'] is {shown(value)}, which no setting takes")
        return str(value)
    if isinstance(value, (list, tuple, np.ndarray)):
        return "[" + ", ".join(_setting(one, where, key) for one in value) + "]"
    raise TypeError(f"{where}: settings['{key}'] is {shown(value)}; give a number, a text or a bool")


def array(value: object, where: str, name: str, wanted: str) -> NDArray[Any]:
    """What numpy makes of a value, of any type and shape; its errors in words of the caller.  wanted: what to give in its place."""
    try:
        return np.asarray(value)
    except Exception as error:
        ragged = isinstance(error, ValueError) and "inhomogeneous" in str(error)
        reason = "has rows of different lengths" if ragged else f"is {shown(value)}, which is no array"
        raise InputError(f"{where}: {name} {reason}; give {wanted}") from None


def floats(value: object, where: str, name: str) -> NDArray[np.float64]:
    """Finite numbers of any shape, contiguous."""
    given = array(value, where, name, "numbers")
    if given.size and given.dtype.kind not in "iuf":
        what = shown(value) if given.ndim == 0 else f"an array of {given.dtype}"
        raise TypeError(f"{where}: {name} is {what}; give numbers")
    found = np.array(given, dtype=np.float64, order="C")
    if not np.isfinite(found).all():
        raise InputError(f"{where}: {name} has the value {found[~np.isfinite(found)].flat[0]}; give finite numbers")
    return found


def positions(value: object, where: str, name: str) -> tuple[NDArray[np.float64], bool]:
    """As [n, 3], and whether it was a single one."""
    found = floats(value, where, name)
    single = found.shape == (3,)
    if not single and (found.ndim != 2 or found.shape[1] != 3):
        raise InputError(f"{where}: {name} has shape {found.shape}; give one position [3] or several [n, 3]")
    if found.size and np.abs(found).max() > FARTHEST_M:
        raise InputError(f"{where}: {name} has the coordinate {found.flat[np.abs(found).argmax()]:g}; give metres, at most {FARTHEST_M:g}")
    return found.reshape(-1, 3), single


def position(value: object, where: str, name: str) -> NDArray[np.float64]:
    found, single = positions(value, where, name)
    if not single:
        raise InputError(f"{where}: {name} has shape {found.shape}; give one position [3]")
    return found


def actions(value: object, count: int, where: str, *, column: bool = False) -> NDArray[np.int32]:
    """[count]: checked before the cast, which would wrap.  column: may be [count, 1]."""
    found = array(value, where, "actions", f"[{count}] integers")
    if column and found.shape == (count, 1):
        found = found[:, 0]
    if found.shape != (count,):
        raise InputError(f"{where}: actions have shape {found.shape}; give [{count}] integers")
    if count and found.dtype.kind not in "iu":
        raise TypeError(f"{where}: actions are of type {found.dtype}; give integers from 0 to {NUM_ACTIONS - 1}")
    if count and not (found.min() >= 0 and found.max() < NUM_ACTIONS):
        wrong = found[(found < 0) | (found >= NUM_ACTIONS)][0]
        raise InputError(f"{where}: actions have the value {wrong}; give integers from 0 to {NUM_ACTIONS - 1}")
    return found.astype(np.int32)


def env_seeds(value: object, num_envs: int, where: str) -> list[int | None]:
    """One per env: of an integer, that plus the number of the env."""
    if value is None:
        return [None] * num_envs
    if (isinstance(value, Sequence) and not isinstance(value, (str, bytes))) or (isinstance(value, np.ndarray) and value.ndim > 0):
        if len(value) != num_envs:
            raise InputError(f"{where}: seed has {len(value)} entries for {num_envs} envs")
        return [None if one is None else seed(one, where, f"seed[{index}]") for index, one in enumerate(value)]
    first = integer(value, where, "seed", 0, LARGEST_SEED - num_envs + 1)
    return [first + env for env in range(num_envs)]
