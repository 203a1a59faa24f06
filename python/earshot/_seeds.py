# SPDX-License-Identifier: Apache-2.0
"""Seeds that keep envs apart: those of several runners that are seeded with neighbouring numbers, and those that are given none."""

from __future__ import annotations

import hashlib
import itertools
import multiprocessing
import re
import secrets

from . import _arguments as check

SEEDS_APART = 2**20  #: as many envs of one seed meet none of the next seed

_begun = itertools.count()  #: envs of this process that have begun without a seed


def spread_seeds(seed: int, num_envs: int, first_env: int = 0, where: str = "reset") -> list[int]:
    """One per env: seed * 2**20 + first_env + i modulo 2**64 for env i.

    Frameworks give runner r the seed plus r, and env i of a batch would get that plus i: most envs of two runners would play the same
    episodes.
    """
    return seeds_from(check.seed(seed, where) * SEEDS_APART + first_env, num_envs)


def seeds_from(first: int, num_envs: int) -> list[int]:
    """first, first + 1, ... modulo 2**64."""
    return [(first + env) % (check.LARGEST_SEED + 1) for env in range(num_envs)]


def drawn_seed() -> int:
    """A seed for spread_seeds from the system's randomness, for envs in processes that know nothing of each other."""
    return secrets.randbits(44)


def own_sequence(config_text: str) -> int | None:
    """The seed of an env that begins without one, so that equal envs of one process, or of processes of one parent, differ.

    None, which stands for the config's own sequence, for the first such env of a program, and where the config gives the order of its
    episodes.  The same program gives the same seeds.

    :param config_text: What Batch.config_text returns.
    """
    if _top_value(config_text, "order") != "random":
        return None
    process = getattr(
        multiprocessing.current_process(), "_identity", ()
    )  # () of the first process, (2, 1) of the first child of its second
    number = next(_begun)
    if not process and number == 0:
        return None
    text = f"{_top_value(config_text, 'seed')} {process} {number}"
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "little")


def _top_value(config_text: str, key: str) -> str:
    found = re.search(rf"^{key}: *(\S+)", config_text, re.MULTILINE)
    return found.group(1) if found else ""
