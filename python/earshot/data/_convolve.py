# SPDX-License-Identifier: Apache-2.0
"""Corpora of reverberant speech, as ``earshot dataset convolve`` writes them."""

from __future__ import annotations

import os
from dataclasses import dataclass

from .. import _arguments as check
from .. import _engine

PathLike = str | os.PathLike[str]


@dataclass(frozen=True)
class Convolved:
    """What :func:`convolve` wrote."""

    written: int  #: signals of this call
    total: int  #: signals of the corpus
    folders_missing: int  #: of other shards; 0: the corpus is complete
    left_out: int  #: bad files, with ``skip_bad``


def convolve(
    corpus: PathLike,
    speech: PathLike,
    out: PathLike,
    *,
    noise: str = "",
    seed: int = 0,
    count: int = 0,
    talkers: tuple[int, int] = (1, 1),
    early: bool = False,
    dry: bool = False,
    stems: bool = False,
    skip_bad: bool = False,
    rt60_s: tuple[float, float] | None = None,
    drr_db: tuple[float, float] | None = None,
    threads: int = 0,
    shard: str = "1/1",
) -> Convolved:
    """Send a folder of dry speech through the responses of a corpus; the bytes are those of ``earshot dataset convolve``.

    The same call completes a folder that was interrupted.

    :param corpus: What ``earshot dataset rir`` wrote as ``--out``.
    :param noise: A folder, "synth" (white) or "synth:KIND"; empty for none.
    :param count: Number of signals; 0 makes one per speech file.
    :param skip_bad: Leave out files that cannot be used, and list them in ``inputs.jsonl``; otherwise the first one raises InputError.
    :param rt60_s: Range over which the reverberation time of the first talker's response is uniform, in tenths.
    :param drr_db: The same for the direct-to-reverberant ratio.
    :raises InputError: A file or argument that cannot be used.
    :raises RunError: The disk is full.
    """
    where = "convolve"
    ranges = []
    for name, given in (("rt60_s", rt60_s), ("drr_db", drr_db)):
        if given is not None and len(given) != 2:
            raise _engine.InputError(f"{where}: {name} is {given}; give LOW, HIGH")
        ranges.append(None if given is None else (check.number(given[0], where, name), check.number(given[1], where, name)))
    written = _engine.write_signals(
        check.path(corpus, where, "corpus"),
        check.path(speech, where, "speech"),
        check.path(out, where, "out"),
        check.text(noise, where, "noise"),
        check.seed(seed, where),
        check.integer(count, where, "count", 0, 100_000_000),
        (check.integer(talkers[0], where, "talkers", 1, 100), check.integer(talkers[1], where, "talkers", 1, 100)),
        (bool(early), bool(dry), bool(stems)),
        bool(skip_bad),
        ranges[0],
        ranges[1],
        check.threads(threads, where),
        check.text(shard, where, "shard"),
    )
    return Convolved(*written)
