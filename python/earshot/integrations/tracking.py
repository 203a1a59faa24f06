# SPDX-License-Identifier: Apache-2.0
"""Loggers for Weights & Biases, MLflow and TensorBoard, and a follower that gives them the curves of a training run.

``python -m earshot.integrations.tracking runs/quick --to wandb --project rooms`` runs beside ``earshot train`` and ends with it.  A
training loop in Python calls the same loggers::

    with MlflowLogger("rooms") as logger:
        logger.log(steps, {"episodes/success": 0.5})
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from .._configs import Config, plain_config
from .._engine import InputError, RunError
from ._common import require
from .runs import follow

MOST_METRICS = 1000  #: in one request to MLflow


class Logger:
    """Takes values by name over environment steps.  Values that are not finite are left out."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close(failed=kind is not None)

    def log(self, env_steps: int, values: Mapping[str, float]) -> None:
        finite = {name: float(value) for name, value in values.items() if math.isfinite(value)}
        if finite:
            self._write(int(env_steps), finite)

    def close(self, failed: bool = False) -> None:
        """End the run of the tracker.  failed: it did not come to its end."""

    def _write(self, env_steps: int, values: dict[str, float]) -> None:
        raise NotImplementedError


class WandbLogger(Logger):
    """Logs to Weights & Biases (extra ``wandb``).

    :param mode: "online", "offline" (files for ``wandb sync``) or "disabled"; the default is that of wandb.
    :param config: A dataclass or a mapping that the run shows as its config.
    :param init: Further arguments of ``wandb.init``.
    """

    def __init__(self, project: str, *, name: str | None = None, mode: Any = None, config: Config = None, **init: Any) -> None:
        wandb = require("wandb", "wandb")
        plain = None if config is None else plain_config(config, "WandbLogger")
        self.run = wandb.init(project=project, name=name, mode=mode, config=plain, **init)
        self.run.define_metric("env_steps")
        self.run.define_metric("*", step_metric="env_steps")

    def close(self, failed: bool = False) -> None:
        self.run.finish(exit_code=1 if failed else 0)

    def _write(self, env_steps: int, values: dict[str, float]) -> None:
        self.run.log({**values, "env_steps": env_steps})


class MlflowLogger(Logger):
    """Logs to MLflow (extra ``mlflow``).

    :param project: Name of the experiment.
    :param tracking_uri: A server, a database or a folder (``file:...``); the default is that of MLflow.
    :param config: A dataclass or a mapping whose keys become parameters.
    """

    def __init__(self, project: str, *, name: str | None = None, tracking_uri: str | None = None, config: Config = None) -> None:
        mlflow = require("mlflow", "mlflow")
        self._metric = mlflow.entities.Metric
        self.client = mlflow.MlflowClient(tracking_uri)
        experiment = self.client.get_experiment_by_name(project)
        number = self.client.create_experiment(project) if experiment is None else experiment.experiment_id
        self.run_id = self.client.create_run(number, run_name=name).info.run_id
        if config is not None:
            for key, value in _dotted(plain_config(config, "MlflowLogger")).items():
                self.client.log_param(self.run_id, key, value)

    def close(self, failed: bool = False) -> None:
        self.client.set_terminated(self.run_id, "FAILED" if failed else "FINISHED")

    def _write(self, env_steps: int, values: dict[str, float]) -> None:
        now_ms = int(time.time() * 1000)
        metrics = [self._metric(name, value, now_ms, env_steps) for name, value in values.items()]
        for first in range(0, len(metrics), MOST_METRICS):
            self.client.log_batch(self.run_id, metrics[first : first + MOST_METRICS])


class TensorBoardLogger(Logger):
    """Writes a TensorBoard file into a folder (extra ``tensorboard``).  ``earshot train`` writes its own into the folder of the run."""

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        writer = require("tensorboard.summary.writer.event_file_writer", "tensorboard")
        self._event = require("tensorboard.compat.proto.event_pb2", "tensorboard").Event
        self._summary = require("tensorboard.compat.proto.summary_pb2", "tensorboard").Summary
        self._writer = writer.EventFileWriter(os.fspath(folder))

    def close(self, failed: bool = False) -> None:
        self._writer.close()

    def _write(self, env_steps: int, values: dict[str, float]) -> None:
        summary = self._summary(value=[self._summary.Value(tag=name, simple_value=value) for name, value in values.items()])
        self._writer.add_event(self._event(wall_time=time.time(), step=env_steps, summary=summary))


def log_run(folder: str | os.PathLike[str], logger: Logger, *, poll_s: float = 1.0, wait_s: float = 0.0) -> int:
    """Give the curve of a run to a logger until the run ends, and return the number of points.

    Arguments and errors are those of :func:`earshot.integrations.runs.follow`.
    """
    count = 0
    for point in follow(folder, poll_s=poll_s, wait_s=wait_s):
        logger.log(point.env_steps, {"update": point.update, "wall_s": point.wall_s, **point.values})
        count += 1
    return count


def _dotted(section: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in section.items():
        found.update(_dotted(value, f"{path}{key}.") if isinstance(value, Mapping) else {path + key: value})
    return found


def _logger(options: argparse.Namespace) -> Logger:
    name = options.name or Path(options.folder).resolve().name
    if options.to == "wandb":
        return WandbLogger(options.project, name=name, mode=options.mode, dir=options.out)
    if options.to == "mlflow":
        return MlflowLogger(options.project, name=name, tracking_uri=options.out)
    return TensorBoardLogger(options.out or Path("tensorboard") / name)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m earshot.integrations.tracking", description="Give the curve of a run to a tracker.")
    parser.add_argument("folder", help="folder of the run (key out of its config)")
    parser.add_argument("--to", choices=("wandb", "mlflow", "tensorboard"), required=True)
    parser.add_argument("--project", default="earshot", help="project of W&B, experiment of MLflow")
    parser.add_argument("--name", help="name of the run there (default: that of the folder)")
    parser.add_argument("--mode", choices=("online", "offline", "disabled"), help="of W&B")
    parser.add_argument("--out", help="folder of W&B or TensorBoard, tracking URI of MLflow")
    parser.add_argument("--wait-s", type=float, default=60.0, help="time that the run may take to begin (default: %(default)g)")
    options = parser.parse_args(arguments)
    try:
        follow_first = follow(options.folder, wait_s=options.wait_s)
        first = next(follow_first, None)
        if first is None:
            raise InputError(f"{options.folder}: has no point of a curve")
        with _logger(options) as logger:
            count = log_run(options.folder, logger)
    except (InputError, ImportError) as error:
        print(f"tracking: {error}", file=sys.stderr)
        return 2
    except RunError as error:
        print(f"tracking: {error}", file=sys.stderr)
        return 1
    except Exception as error:  # of the tracker: its classes are many
        if isinstance(error, OSError) and error.filename is not None:
            print(f"tracking: {error.filename}: {error.strerror}", file=sys.stderr)
            return 2
        reason = (str(error).strip() or "no reason given").splitlines()[0]
        print(f"tracking: {options.to}: {type(error).__name__}: {reason}", file=sys.stderr)
        return 1
    print(f"{options.folder}: {count} points to {options.to}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
