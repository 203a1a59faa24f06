# SPDX-License-Identifier: Apache-2.0
"""Parts of a work as tasks of Ray."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from typing import Any

from .._engine import InputError, RunError
from .._progress import Progress

import ray as _ray  # isort: skip

ray: Any = _ray  #: the framework, some of whose calls have no types

#: Attempts at a part beyond the first.  Ray makes a part again whose worker or node is lost, also where its finished result is lost.
RETRIES = 10


def start() -> None:
    """Connects to the cluster of the variable RAY_ADDRESS or, without one, starts Ray on this machine."""
    if not ray.is_initialized():
        ray.init(address=os.environ.get("RAY_ADDRESS"), log_to_driver=False, include_dashboard=False)


def require_positive(what: str, **numbers: float) -> None:
    for name, number in numbers.items():
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise TypeError(f"{what}: {name} must be a number, not {type(number).__name__}")
        if not (math.isfinite(number) and number > 0):
            raise InputError(f"{what}: {name} is {number}; it must be above 0")


def slots(cpus: float) -> int:
    """How many tasks of so many cores the cluster can run at once."""
    return int(ray.cluster_resources().get("CPU", 0) // cpus)


def require_room(what: str, cpus: float, name: str) -> None:
    """Refuses tasks that no node could ever run; Ray would wait for such a node."""
    largest = max((node["Resources"].get("CPU", 0) for node in ray.nodes() if node["Alive"]), default=0)
    if cpus > largest:
        raise InputError(f"{what}: {name} is {cpus:g}, but the largest node has {largest:g} cores; use at most so many")


def guarded(function: Callable[..., Any], *arguments: Any) -> tuple[str, Any]:
    """The result of a function, or the kind and the text of its error: errors of the engine then keep their type."""
    try:
        return "done", function(*arguments)
    except InputError as error:
        return "input", str(error)
    except RunError as error:
        return "run", str(error)


def result_of(what: str, reference: Any) -> Any:
    try:
        kind, value = ray.get(reference)
    except ray.exceptions.RayTaskError as error:
        raise error.as_instanceof_cause() from None
    except ray.exceptions.RayError as error:
        lines = str(error).splitlines()
        raise RunError(f"{what}: {type(error).__name__}: {lines[0] if lines else 'no message'}") from error
    if kind == "input":
        raise InputError(value)
    if kind == "run":
        raise RunError(value)
    return value


def run_parts(
    what: str,
    function: Callable[..., Any],
    parts: Sequence[int],
    shared: Any,
    *,
    cpus: float,
    finish: Callable[[int, Any], str],
    progress: bool,
    unit: str = "parts",
) -> None:
    """Runs function(shared, part) for all parts on the nodes, and finish(part, result) here as they end, in any order.

    At most twice as many parts as can run at once are asked for, so that finished ones do not fill the memory of the nodes.

    :param finish: Returns a note for the line of progress.
    :raises InputError: `function` raised it; the other parts are given up.
    :raises RunError: Likewise, or a part was lost RETRIES + 1 times.
    """
    task = ray.remote(num_cpus=cpus, max_retries=RETRIES)(guarded)
    kept = ray.put(shared)
    waiting, running = list(reversed(parts)), dict[Any, int]()
    line = Progress(what, unit, len(parts), shown=progress)
    try:
        while waiting or running:
            while waiting and len(running) < 2 * max(1, slots(cpus)):
                part = waiting.pop()
                running[task.options(name=f"{what}, part {part}").remote(function, kept, part)] = part
            ended, _ = ray.wait(list(running), num_returns=1, timeout=1)
            note = ""
            for reference in ended:
                part = running.pop(reference)
                note = finish(part, result_of(what, reference))
            line.update(len(parts) - len(waiting) - len(running), note)
    finally:
        for reference in running:
            ray.cancel(reference, force=True)
        line.close()
