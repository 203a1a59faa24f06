# SPDX-License-Identifier: Apache-2.0
"""Trainings of `earshot train` as trials of Ray Tune."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from ray import tune

from .._engine import InputError, RunError
from .._program import find_program, run_program, text_arguments
from ..integrations.runs import LEASE_S, _Curve, is_under_way
from ._tasks import RETRIES, require_positive, require_room, start

Trainable = Callable[[Mapping[str, Any]], None]
_SHORT = {"success": "episodes/success", "spl": "episodes/spl", "reward": "episodes/reward", "loss": "policy/loss"}


class _Reports:
    """Hands the points of a curve to Tune, each once, while the run writes them."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.curve = folder, _Curve(folder)
        self.seen: set[tuple[int, bool]] = set()

    def send(self) -> None:
        if not self.curve.path.exists():
            return
        for point in self.curve.new():
            key = (point.update, point.is_held_out)
            if key in self.seen:  # a resumed run repeats points with the same values
                continue
            self.seen.add(key)
            short = {name: point.values[key] for name, key in _SHORT.items() if key in point.values}
            tune.report({"update": point.update, "env_steps": point.env_steps, "wall_s": point.wall_s, **short, **point.values})


def _run_and_report(command: Sequence[str], cwd: str, folder: Path, environment: Mapping[str, str]) -> str:
    end = time.monotonic() + 2 * LEASE_S
    while is_under_way(folder) and time.monotonic() < end:  # the run of a node that was lost: its lock ends with its lease
        time.sleep(0.5)
    reports = _Reports(folder)
    said = run_program(command, cwd=cwd, environment=environment, ends_with=signal.SIGTERM, poll=reports.send, poll_s=0.5)
    reports.send()
    return said


def _environment() -> dict[str, str]:
    """Variables of the caller: Ray sets numbers of threads in those of its workers."""
    return dict(os.environ)


def _value(key: str, value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(key, each) for each in value) + "]"
    if isinstance(value, int | float | str):
        return repr(value) if isinstance(value, float) else str(value)
    if hasattr(value, "item"):  # of NumPy, as random samples of Tune are
        return _value(key, value.item())
    raise TypeError(f"trainable: {key} is a {type(value).__name__}; a search space holds numbers, texts, bools and lists of these")


def trainable(
    config: str | os.PathLike[str],
    overrides: Sequence[str] = (),
    *,
    out: str | os.PathLike[str],
    program: str | os.PathLike[str] | None = None,
) -> Trainable:
    """A training as a function for ``tune.Tuner``. Keys of the search space are keys of the config, such as ``"ppo.learning_rate"``.

    Each update is reported with the names of events.jsonl, and with ``success``, ``spl``, ``reward`` and ``loss``. A trial trains in
    ``OUT/TRIAL``, which all nodes must see. A trial that Tune stops, or that is lost with its node, leaves a checkpoint; where Tune starts
    it again, it goes on from there.

    :param config: Run config of ``earshot train``.
    :param overrides: Texts "a.b=value" for all trials.
    :raises InputError: The program or the config is missing.

    >>> space = {"ppo.learning_rate": tune.loguniform(1e-4, 1e-3)}                                        # doctest: +SKIP
    >>> tune.Tuner(earshot.ray.trainable("configs/train/quick.yaml", out="/shared/lr"), param_space=space).fit()    # doctest: +SKIP
    """
    path, cwd, environment = find_program(program), os.getcwd(), _environment()
    shared = text_arguments("trainable", overrides, {"out": "is the argument out"})
    if not os.path.exists(config):
        raise InputError(f"trainable: {config} does not exist; name a run config of earshot train")
    name, folder_of_all = os.fspath(config), os.path.abspath(out)

    def train(space: Mapping[str, Any]) -> None:
        folder = Path(folder_of_all) / str(tune.get_context().get_trial_id())
        keys = [f"{key}={_value(key, value)}" for key, value in space.items()]
        begun = any((folder / "checkpoints").glob("*.ckpt"))
        how = ["--resume", str(folder)] if begun else ["--overwrite"]
        _run_and_report([path, "train", name, *shared, *keys, f"out={folder}", *how], cwd, folder, environment)

    return train


def sweep(
    file: str | os.PathLike[str],
    *,
    cpus_per_run: float = 1,
    program: str | os.PathLike[str] | None = None,
    scheduler: Any = None,
    verbose: int = 0,
) -> Any:
    """Run a sweep of ``earshot sweep`` with the nodes of a cluster, each run as a trial of Tune: the files of one process after another.

    All nodes must see the sweep file, its config and its folder `out` under the same paths. A run that is lost with its node goes on
    from its last checkpoint. A call that was interrupted is repeated to go on; finished runs are kept.

    :param file: Sweep file, such as configs/sweeps/learning_rate.yaml.
    :param cpus_per_run: Cores that a run takes: the `workers` of its config.
    :param scheduler: One of ``ray.tune.schedulers``. Runs that it stops count as unfinished.
    :param verbose: That of Tune: 1 prints a table of the trials while they run.
    :return: The ``ResultGrid`` of Tune, in the order of the file. The table and the page are in `out`, as ``earshot sweep`` writes them.
    :raises InputError: The sweep file, or one of its runs, is wrong.
    :raises RunError: A run failed; the line names it.
    """
    require_positive("sweep", cpus_per_run=cpus_per_run)
    path, cwd, environment, text = find_program(program), os.getcwd(), _environment(), os.fspath(file)
    run_program([path, "sweep", text, "--report"], cwd=cwd)  # refuses what is wrong with it
    keys = yaml.safe_load(Path(text).read_text())
    out = Path(os.path.abspath(keys.get("out", f"runs/sweeps/{keys.get('name', Path(text).stem)}")))
    runs = [f"{variant}/seed_{seed}" for variant in keys["runs"] for seed in keys["seeds"]]
    start()
    require_room("sweep", cpus_per_run, "cpus_per_run")

    def train(space: Mapping[str, Any]) -> None:
        command = [path, "sweep", text, "--run", space["run"]]
        _run_and_report(command, cwd, out / space["run"], environment)
        if not (out / (space["run"] + ".done")).exists():
            raise RunError(f"sweep {space['run']}: ended before its time")

    begin = time.strftime("%Y%m%d-%H%M%S")
    results = tune.Tuner(
        tune.with_resources(train, {"CPU": cpus_per_run}),
        param_space={"run": tune.grid_search(runs)},
        tune_config=tune.TuneConfig(
            scheduler=scheduler, metric=None if scheduler is None else "success", mode=None if scheduler is None else "max"
        ),
        run_config=tune.RunConfig(
            name=begin,
            storage_path=str(out / "tune"),
            verbose=verbose,
            failure_config=tune.FailureConfig(max_failures=RETRIES),
        ),
    ).fit()
    run_program([path, "sweep", text, "--report"], cwd=cwd)
    for error in results.errors:
        lines = str(error).strip().splitlines()
        raise RunError(f"sweep {file}: {lines[-1] if lines else type(error).__name__}")
    return results
