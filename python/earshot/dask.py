# SPDX-License-Identifier: Apache-2.0
"""Corpora of `earshot dataset` with Dask: see :func:`corpus`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

from . import _corpus_parts
from ._progress import Progress
from .integrations._common import require

distributed = require("distributed", "dask")


def corpus(
    command: str,
    arguments: Sequence[str | os.PathLike[str]],
    *,
    out: str | os.PathLike[str],
    client: Any = None,
    threads_per_part: int = 1,
    scratch: str | None = None,
    program: str | os.PathLike[str] | None = None,
    progress: bool = True,
) -> str:
    """Write a corpus with the workers of Dask: the bytes of one process. A call that was interrupted is repeated to go on.

    Parts, and what the workers need, are as in :func:`earshot.ray.corpus`. Parts of lost workers are made again.

    :param client: A ``distributed.Client``; default: the current one, else a cluster on this machine.
    :raises InputError: Wrong arguments, or `out` has another corpus.
    :raises RunError: A part failed.
    """
    work = _corpus_parts.plan(command, arguments, out, program)
    if not work.missing:
        return work.out
    own = None
    if client is None:
        try:
            client = distributed.get_client()
        except ValueError:
            client = own = distributed.Client()
    line = Progress(f"corpus {out}", "parts", len(work.missing), shown=progress)
    waiting, done, recordings = list(reversed(work.missing)), 0, 0
    try:
        shared = client.scatter(work, broadcast=True)

        def submit() -> Any:
            folder = waiting.pop()
            future = client.submit(_corpus_parts.make_part, shared, folder, threads_per_part, scratch, pure=False)
            folders[future.key] = folder
            return future

        folders: dict[str, int] = {}
        # Twice as many as can run at once, so that finished parts do not fill the memory of the workers.
        window = 2 * max(1, sum(client.nthreads().values()))
        ended = distributed.as_completed([submit() for _ in range(min(window, len(waiting)))])
        for future in ended:
            recordings += _corpus_parts.keep_part(work.out, folders.pop(future.key), future.result())
            future.release()
            done += 1
            line.update(done, f"{recordings} recordings")
            if waiting:
                ended.add(submit())
    finally:
        line.close()
        if own is not None:
            own.close()
    _corpus_parts.join(work)
    return work.out
