# SPDX-License-Identifier: Apache-2.0
"""What the adapters share."""

from __future__ import annotations

import importlib
import importlib.metadata
from typing import Any

from numpy.typing import NDArray

Observation = dict[str, NDArray[Any]]


def require(package: str, extra: str, *, at_least: int = 0) -> Any:
    """The package, or an ImportError that says how to install it.  at_least: its oldest version, whose first number it is."""
    try:
        module = importlib.import_module(package)
    except ImportError as error:
        raise ImportError(f"earshot.integrations needs {package}: pip install 'earshot-rl[{extra}]' ({error})") from error
    if at_least:
        version = importlib.metadata.version(package)
        if int(version.split(".")[0]) < at_least:
            raise ImportError(f"{package} {version} is too old: pip install '{package}>={at_least}.0'")
    return module


def end_of(metrics: dict[str, Any], env: int) -> dict[str, Any]:
    """The metrics of one env out of the batched infos of a step, without masks."""
    return {key: value[env].item() for key, value in metrics.items() if not key.startswith("_") and metrics[f"_{key}"][env]}
