# SPDX-License-Identifier: Apache-2.0
"""Entry points of the ids in earshot.registration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from . import _arguments as check
from ._configs import Config
from .single import EarshotEnv

if TYPE_CHECKING:
    from .vector import EarshotVectorEnv


class RegisteredEnv(EarshotEnv):
    """The single env of an id.  rules: overrides that belong to the id; those of the user come after them."""

    def __init__(self, config: Config, *, rules: Sequence[str] = (), overrides: Sequence[str] = (), **arguments: Any) -> None:
        super().__init__(config, overrides=[*rules, *check.texts(overrides, "make", "overrides")], **arguments)


def make_registered_vec(
    config: Config,
    num_envs: int = 1,
    *,
    rules: Sequence[str] = (),
    overrides: Sequence[str] = (),
    max_episode_steps: int | None = None,
    copy: bool = True,
    **arguments: Any,
) -> EarshotVectorEnv:
    """The batch of an id.  Observations are copies, as those of gymnasium's own batches are; copy=False gives views.

    max_episode_steps: replaces task.max_steps of the config.
    """
    from .vector import EarshotVectorEnv

    lines = [*rules, *check.texts(overrides, "make_vec", "overrides")]
    return EarshotVectorEnv(config, num_envs, overrides=lines, copy=copy, max_episode_steps=max_episode_steps, **arguments)
