# SPDX-License-Identifier: Apache-2.0
"""Evaluations of `earshot eval`, their parts run on the nodes of a cluster."""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .._engine import InputError, RunError
from .._program import find_program, run_program, text_arguments
from ._tasks import ray, require_positive, require_room, run_parts, slots, start

_REFUSED = {
    "--out": "is the argument out",
    "--shard": "is set for each part",
    "--parts": "is set for each part",
    "--threads": "is the argument cpus_per_part",
    "--workers": "has no place in a part",
    "--json": "is not written here: use earshot leaderboard",
}
_SETTINGS = "evaluation.txt"  #: of the folder of parts: all that the result depends on


def _evaluate(shared: tuple[list[str], str, int, int, str | None], part: int) -> tuple[bytes, bytes]:
    """The settings and the result of part 1, 2, ..."""
    command, cwd, parts, threads, scratch = shared
    node = ray.get_runtime_context().get_node_id()[:8]
    with tempfile.TemporaryDirectory(prefix=f"earshot-{node}-eval-{part}-", dir=scratch) as folder:
        run_program([*command, "--shard", f"{part}/{parts}", "--parts", folder, "--threads", str(threads)], cwd=cwd)
        return (Path(folder) / _SETTINGS).read_bytes(), (Path(folder) / f"part_{part}.json").read_bytes()


def evaluate(
    agent: str | os.PathLike[str],
    arguments: Sequence[str | os.PathLike[str]] = (),
    *,
    out: str | os.PathLike[str],
    parts: int | None = None,
    cpus_per_part: int = 1,
    scratch: str | None = None,
    program: str | os.PathLike[str] | None = None,
    progress: bool = True,
) -> dict[str, Any]:
    """Evaluate an agent with the nodes of a cluster: the result file of one process, byte for byte.

    Parts are kept in the folder ``OUT.parts`` until all are there, so a call that was interrupted is repeated to go on. Nodes need the
    program, the agent, the config and the episodes under the same paths.

    :param agent: AGENT of ``earshot eval``.
    :param arguments: Further arguments of ``earshot eval`` without --out, --json, --threads and --workers.
    :param out: The result file, on the machine of the caller.
    :param parts: Number of parts; default: as many as the cluster runs at once. A part loads its scenes itself.
    :param cpus_per_part: Cores, and threads, of a part.
    :param scratch, program, progress: As in :func:`earshot.ray.corpus`.
    :return: The result, as ``json.load`` reads the file.
    :raises InputError: Wrong arguments, or the folder of parts has those of another evaluation.
    :raises RunError: A part failed, or its nodes were lost eleven times.
    """
    require_positive("evaluate", cpus_per_part=cpus_per_part, **({} if parts is None else {"parts": parts}))
    command = [find_program(program), "eval", os.fspath(agent), *text_arguments("evaluate", arguments, _REFUSED)]
    result, cwd = Path(os.path.abspath(out)), os.getcwd()
    folder = result.with_name(result.name + ".parts")
    settings = folder / _SETTINGS
    start()
    require_room("evaluate", cpus_per_part, "cpus_per_part")
    begun = re.match(r"parts: (\d+)\n", settings.read_text()) if settings.exists() else None
    count = parts or (int(begun.group(1)) if begun else max(1, slots(cpus_per_part)))

    def finish(part: int, made: tuple[bytes, bytes]) -> str:
        if not settings.exists():
            folder.mkdir(parents=True, exist_ok=True)
            _write(settings, made[0])
        elif settings.read_bytes() != made[0]:
            raise InputError(f"{folder}: has parts of another evaluation, or nodes have other files; remove it, or use another result file")
        _write(folder / f"part_{part}.json", made[1])
        return ""

    missing = [part for part in range(1, count + 1) if not (folder / f"part_{part}.json").exists()]
    shared = (command, cwd, count, int(cpus_per_part), scratch)
    run_parts(f"evaluate {agent}", _evaluate, missing, shared, cpus=cpus_per_part, finish=finish, progress=progress)
    run_program([*command, "--shard", f"1/{count}", "--parts", str(folder), "--out", str(result)], cwd=cwd)
    if not result.exists():
        raise RunError(f"{folder}: parts are missing although all were made; run the same call again")
    shutil.rmtree(folder)
    found: dict[str, Any] = json.loads(result.read_bytes())
    return found


def _write(path: Path, data: bytes) -> None:
    unfinished = path.with_name(path.name + ".unfinished")
    unfinished.write_bytes(data)
    os.replace(unfinished, path)
