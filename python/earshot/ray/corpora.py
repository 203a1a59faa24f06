# SPDX-License-Identifier: Apache-2.0
"""Corpora of `earshot dataset`, their parts made on the nodes of a cluster."""

from __future__ import annotations

import os
from collections.abc import Sequence

from .. import _corpus_parts
from ._tasks import ray, require_positive, require_room, run_parts, start


def _make_in_place(shared: tuple[_corpus_parts.Plan, int, str | None], folder: int) -> int:
    return _corpus_parts.make_part_in_place(shared[0], folder, shared[1])


def _make(shared: tuple[_corpus_parts.Plan, int, str | None], folder: int) -> _corpus_parts.Bundle:
    work, threads, scratch = shared
    node = ray.get_runtime_context().get_node_id()[:8]
    return _corpus_parts.make_part(work, folder, threads, scratch, f"{node}-")


def corpus(
    command: str,
    arguments: Sequence[str | os.PathLike[str]],
    *,
    out: str | os.PathLike[str],
    cpus_per_part: int = 1,
    shared: bool = False,
    scratch: str | None = None,
    program: str | os.PathLike[str] | None = None,
    progress: bool = True,
) -> str:
    """Write a corpus with the nodes of a cluster: the bytes of one process. A call that was interrupted is repeated to go on.

    A part is a numbered folder of the corpus. A node makes it in a folder of its own, and the caller writes it to `out`, so the nodes
    need not see `out`. With `shared` the nodes write to `out` themselves, which many nodes need: the disk of the caller then bounds
    nothing. Nodes need the program and the input files (config, meshes, speech) under the same paths.

    :param command: "rir", "convolve", "scenes" or "pano".
    :param arguments: Those of ``earshot dataset COMMAND`` without --out, --shard and --threads.
    :param out: Folder on the machine of the caller.
    :param cpus_per_part: Cores, and threads, of a part. More than 1 for scenes that would not fit into memory once per core.
    :param shared: All nodes see `out`, on a shared file system.
    :param scratch: Folder of the nodes for parts that are being made; default: that for temporary files.
    :param program: Path of `earshot`; default: the variable EARSHOT_PROGRAM, else the PATH.
    :param progress: Print a line with the rate and the time to go to stderr.
    :return: The absolute path of the corpus.
    :raises InputError: Wrong arguments, `out` has another corpus, or with `shared` a node does not see it.
    :raises RunError: A part failed, or its nodes were lost eleven times.

    >>> earshot.ray.corpus("rir", ["configs/datasets/rir.yaml", "--set", "scenes=[]"], out="runs/rir")   # doctest: +SKIP
    """
    require_positive("corpus", cpus_per_part=cpus_per_part)
    work = _corpus_parts.plan(command, arguments, out, program)
    if not work.missing:
        return work.out
    start()
    require_room("corpus", cpus_per_part, "cpus_per_part")
    recordings = 0

    def finish(folder: int, made: _corpus_parts.Bundle | int) -> str:
        nonlocal recordings
        recordings += made if isinstance(made, int) else _corpus_parts.keep_part(work.out, folder, made)
        return f"{recordings} recordings"

    make = _make_in_place if shared else _make
    run_parts(
        f"corpus {out}", make, work.missing, (work, int(cpus_per_part), scratch), cpus=cpus_per_part, finish=finish, progress=progress
    )
    _corpus_parts.join(work)
    return work.out
