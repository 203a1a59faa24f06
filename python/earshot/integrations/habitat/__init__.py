# SPDX-License-Identifier: Apache-2.0
"""Earshot as a simulator of Habitat-Lab (extra ``habitat``)::

    from earshot.integrations import habitat as earshot_habitat

    earshot_habitat.standalone()  # where habitat_sim is not installed; before habitat is imported
    import habitat

    env = habitat.Env(earshot_habitat.get_config(["habitat.dataset.data_path=set.json.gz"]).habitat)

:func:`register` adds to Habitat-Lab's registry and to its configs:

==========  =======================================================================================================
kind        names
==========  =======================================================================================================
simulator   ``Earshot-v0``
tasks       ``AudioGoal-v0``, ``SemanticAudioGoal-v0``, as ``AudioNav`` and ``SemanticAudioNav`` too
data sets   ``AudioNav``, ``SemanticAudioNav``, as ``AudioGoal-v0`` and ``SemanticAudioGoal-v0`` too
sensors     ``EarshotRGBSensor``, ``EarshotDepthSensor``, ``EarshotSemanticSensor``, ``EarshotAudioGoalSensor``,
            ``EarshotSpectrogramSensor`` of the simulator; ``AudioGoalSensor``, ``SpectrogramSensor`` of a task
measures    ``EarshotDistanceToGoal``, ``NormalizedDistanceToGoal``, ``SNA``, ``SuccessWhenSilent``, ``NumberOfAction``
==========  =======================================================================================================

This module imports nothing of Habitat-Lab by itself.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._common import require

if TYPE_CHECKING:
    from .audio_sensor import AudioSensor

__all__ = ["AudioSensor", "get_config", "make_env", "register", "standalone"]

CONFIGS = Path(__file__).parent / "configs"  #: audiogoal.yaml, semantic_audiogoal.yaml

_is_registered = False


def standalone() -> None:
    """Let Habitat-Lab run without habitat_sim, magnum and corrade, and register Earshot.

    Puts modules in their place that can be imported and subclassed, and raise ImportError where they are used.  Call it at the top of a
    program, before habitat is imported and outside ``if __name__ == "__main__"``: processes of a VectorEnv run that part again.

    :raises ImportError: habitat-lab is not installed.
    """
    from . import _standins

    with _standins.installed():
        register()


def register() -> None:
    """Add Earshot to the registry and the configs of Habitat-Lab.  A second call does nothing.

    :raises ImportError: habitat-lab is not installed, or habitat_sim is not and :func:`standalone` was not called.
    """
    global _is_registered
    if _is_registered:
        return
    try:
        require("habitat", "habitat")
    except ImportError as error:
        if any(name in str(error) for name in ("'habitat_sim'", "'magnum'", "'corrade'")):
            raise ImportError(
                f"habitat-lab needs habitat_sim ({error.__cause__}): install it, or call earshot.integrations.habitat.standalone() first"
            ) from error
        raise
    from . import configs, datasets, sensors, simulator, tasks  # noqa: F401  # each registers its classes

    configs.register()
    _is_registered = True


def get_config(overrides: Sequence[str] = (), task: str = "audiogoal") -> Any:
    """The config of a task, as ``habitat.get_config`` gives it.

    :param overrides: Texts "habitat.dataset.data_path=..." as Habitat-Lab takes them.
    :param task: "audiogoal", "semantic_audiogoal", or the path of a YAML file.
    """
    register()
    import habitat

    packaged = CONFIGS / f"{task}.yaml"
    return habitat.get_config(os.fspath(packaged if packaged.exists() else task), list(overrides))


def make_env(config: Any, dataset: Any = None) -> Any:
    """A gym environment with the reward of the task, for ``habitat.VectorEnv(make_env_fn=make_env, env_fn_args=[(config,), ...])``.

    :param config: Of :func:`get_config`; a ``habitat.Env`` of its part ``habitat`` has no rewards.
    """
    register()
    from habitat.core.environments import GymHabitatEnv

    return GymHabitatEnv(config.habitat if "habitat" in config else config, dataset)


def __getattr__(name: str) -> Any:
    if name == "AudioSensor":
        from .audio_sensor import AudioSensor

        return AudioSensor
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
