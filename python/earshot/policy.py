# SPDX-License-Identifier: Apache-2.0
"""Trained policies outside the trainer: numpy alone, or exported to ONNX."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _arguments as check
from ._configs import FOLDER, PREFIX
from ._engine import InputError
from ._network import NUM_ACTIONS, Architecture, Array, Network, Sensor
from ._policy_file import read_policy_file

Observations = Mapping[str, Any]

MOST_ENVS = 1_000_000


class Policy:
    """A trained agent that acts on numpy arrays, without torch::

        policy = earshot.Policy.load("earshot:policies/quick")
        envs = earshot.make_vec("earshot:train/quick", 8, autoreset_mode="same_step")
        observations, _ = envs.reset(seed=1)
        begins = np.ones(envs.num_envs, bool)
        while True:
            actions = policy.act(observations, begins)          # int32 [N]: the likeliest ones
            observations, _, ends, cuts, _ = envs.step(actions)
            begins = ends | cuts

    Logits differ from those of the program by rounding, at most 1e-5 * (1 + the largest magnitude of a logit).  One thread at a time.
    """

    def __init__(self, fields: Mapping[str, Any], where: str) -> None:
        try:
            self._architecture = Architecture.of(fields["architecture"])
        except ValueError as error:
            raise InputError(f"{where}: {error}") from error
        self._fields = fields
        self._network = Network(self._architecture, fields["weights"])
        self._state: Array | None = None
        self._check_weights(where)

    @staticmethod
    def load(path: str | Path) -> Policy:
        """Reads a policy file, a checkpoint, or the agent that the package brings: "earshot:policies/quick".

        Raises InputError: no such file, damaged, or a network that is a TorchScript module.
        """
        name = check.path(path, "Policy.load", "path")
        return Policy(read_policy_file(_file_of(name)), name)

    @property
    def architecture(self) -> str:
        """Sensors, shapes and sizes in one line."""
        return str(self._fields["architecture"])

    @property
    def config_text(self) -> str:
        """The run config that the policy was trained by, as YAML: `earshot.make_vec` takes it as a file."""
        return str(self._fields["config_yaml"])

    @property
    def observation_shapes(self) -> dict[str, tuple[int, ...]]:
        """Name and shape of one row of each observation that the policy reads."""
        return {sensor.name: sensor.shape for sensor in self._architecture.sensors}

    @property
    def num_parameters(self) -> int:
        return sum(int(array.size) for name, array in self.weights.items() if not name.startswith("value_"))

    @property
    def weights(self) -> Mapping[str, NDArray[Any]]:
        """By name; do not write to them."""
        weights: Mapping[str, NDArray[Any]] = self._fields["weights"]
        return weights

    @property
    def has_value(self) -> bool:
        """False for a critic that reads what only a training knows: its values are 0 here."""
        return not self._architecture.guided_critic

    def initial_state(self, num_envs: int) -> Array:
        """The recurrent state [num_envs, H] at the start of an episode."""
        count = check.integer(num_envs, "Policy.initial_state", "num_envs", 1, MOST_ENVS)
        return np.zeros((count, self._architecture.hidden_size), np.float32)

    def step(self, observations: Observations, state: Array) -> tuple[Array, Array, Array]:
        """One step of N envs, of which the caller keeps the state.

        observations: arrays [N, ...] by name; others than those of observation_shapes are not read.  state: [N, H], zero where an episode
        begins.  Returns logits [N, 4] (stop, forward, left, right), values [N] and the next state.  Raises InputError for an observation
        that is missing, has another shape or another kind of numbers than the environments give, or is not finite, and for such a state.
        """
        rows = {sensor.name: self._rows(sensor, observations) for sensor in self._architecture.sensors}
        state = _finite_state(state, self._architecture.hidden_size)
        sizes = {name: len(array) for name, array in rows.items()} | {"state": len(state)}
        if len(set(sizes.values())) != 1:
            raise InputError(f"observations: have different numbers of rows, {sizes}; give all of them those of the same envs")
        return self._network.step(rows, state)

    def act(self, observations: Observations, begins: Any = None, *, sample: bool = False, rng: np.random.Generator | None = None) -> Any:
        """One action per env; the policy keeps its state from call to call.

        observations: as in step(), or of a single env without the first dimension; then the result is one int.  begins: [N] bool, true
        where these observations are the first of an episode; None: where the number of envs differs from the call before, all, else
        none.  sample: draws from the policy's distribution by rng (default: a fresh generator) in place of the likeliest action.
        """
        if rng is not None and not isinstance(rng, np.random.Generator):
            raise TypeError(f"Policy.act: rng is {check.shown(rng)}; give a numpy.random.Generator")
        draws = check.flag(sample, "Policy.act", "sample")
        first = self._architecture.sensors[0]
        single = self._array(first, observations).ndim == len(first.shape)
        if single:
            observations = {sensor.name: self._array(sensor, observations)[None] for sensor in self._architecture.sensors}
        count = len(self._rows(first, observations))
        if self._state is None or len(self._state) != count:
            self._state = self.initial_state(count)
        if begins is not None:
            mask = np.atleast_1d(check.array(begins, "Policy.act", "begins", f"one bool for each of {count} envs"))
            if mask.shape != (count,) or mask.dtype.kind not in "biu":
                what = f"has the shape {_shape_text(mask)}" if mask.shape != (count,) else f"is of type {mask.dtype}"
                raise InputError(f"Policy.act: begins {what}; give one bool for each of {count} envs")
            self._state = np.where(mask.astype(bool)[:, None], np.float32(0), self._state)
        logits, _, self._state = self.step(observations, self._state)
        actions = _drawn(logits, rng or np.random.default_rng()) if draws else logits.argmax(1).astype(np.int32)
        return int(actions[0]) if single else actions

    def to_onnx(self, path: str | Path) -> None:
        """Writes the network as an ONNX model (needs the package onnx; extra `onnx`).

        Inputs: the observations [N, ...] by name, and "state" [N, H], zero where an episode begins.  Outputs: "logits" [N, 4],
        "next_state" [N, H], and "value" [N] if has_value.
        """
        from ._onnx import write_onnx

        write_onnx(self._architecture, self.weights, Path(path))

    def _array(self, sensor: Sensor, observations: Observations) -> NDArray[Any]:
        if not isinstance(observations, Mapping):
            raise TypeError(f"observations are {check.shown(observations)}; give a dict of arrays by name")
        if sensor.name not in observations:
            raise InputError(
                f"observations: have no '{sensor.name}', which the policy reads; it reads {', '.join(self.observation_shapes)}"
            )
        shape = "x".join(map(str, sensor.shape))
        return check.array(observations[sensor.name], "observations", f"'{sensor.name}'", f"rows of {shape} {_values_of(sensor)[1]}")

    def _rows(self, sensor: Sensor, observations: Observations) -> NDArray[Any]:
        array, where = self._array(sensor, observations), f"observation '{sensor.name}'"
        if array.shape[1:] != sensor.shape or array.ndim != len(sensor.shape) + 1:
            wanted = "x".join(["N", *map(str, sensor.shape)])
            raise InputError(f"{where}: has the shape {_shape_text(array)}; the policy reads {wanted}")
        if len(array) == 0:
            raise InputError(f"{where}: has no rows; give those of at least one env")
        kinds, words, low, high = _values_of(sensor)
        if array.dtype.kind not in kinds:
            raise InputError(f"{where}: has numbers of type {array.dtype}; the policy reads {words}, as the environments give them")
        if not (float(array.min()) >= low and float(array.max()) <= high):  # neither holds for NaN
            limits = "no finite numbers" if kinds == "f" else f"outside {low} to {high}"
            raise InputError(f"{where}: has values that are {limits}")
        return array

    def _check_weights(self, where: str) -> None:
        """That a step works, so that a file whose weights do not fit its architecture is refused when it is read."""
        for name, array in self.weights.items():
            if not np.isfinite(array).all():
                raise InputError(f"{where}: has weights '{name}' that are not finite; use an earlier checkpoint")
        names = self.observation_shapes
        try:
            logits, _, state = self._network.step(
                {name: np.zeros((1, *shape), np.uint8) for name, shape in names.items()}, self.initial_state(1)
            )
        except (KeyError, ValueError, IndexError) as error:
            raise InputError(f"{where}: has weights that do not fit its architecture ({error}); export it again") from error
        if logits.shape != (1, NUM_ACTIONS) or state.shape != (1, self._architecture.hidden_size):
            raise InputError(f"{where}: has weights that do not fit its architecture; export it again")


def _file_of(name: str) -> Path:
    if not name.startswith(PREFIX):
        return Path(name)
    known = {f"{PREFIX}policies/{file.stem}": file for file in sorted((FOLDER / "policies").glob("*.policy"))}
    if name not in known:
        raise InputError(f"{name}: the package has no such policy; it has {', '.join(known)}")
    return known[name]


def _shape_text(array: NDArray[Any]) -> str:
    return "x".join(map(str, array.shape)) or "of a single number"


def _values_of(sensor: Sensor) -> tuple[str, str, float, float]:
    """What an observation consists of: kinds of numpy's types, their name, and the limits of the values."""
    if sensor.kind == "previous_action":
        return "iu", "integers", -1, NUM_ACTIONS - 1
    if sensor.kind == "collision":
        return "iub", "integers or bools", 0, 1
    if sensor.is_bytes:
        return "u", "unsigned integers", 0, 255
    if sensor.kind == "semantic":
        return "iu", "integers", 0, 65535
    largest = float(np.finfo(np.float32).max)
    return "f", "floats", -largest, largest


def _finite_state(state: object, size: int) -> Array:
    array = check.array(state, "Policy.step", "state", f"floats [N, {size}], at first initial_state(N)")
    if array.ndim != 2 or array.shape[1] != size:
        raise InputError(f"Policy.step: state has the shape {_shape_text(array)}; start with initial_state(N), which is Nx{size}")
    if array.dtype.kind not in "fiu":
        raise InputError(f"Policy.step: state is of type {array.dtype}; give floats, at first initial_state(N)")
    with np.errstate(over="ignore"):
        found: Array = array.astype(np.float32, copy=False)
    if not np.isfinite(found).all():
        raise InputError("Policy.step: state has values that are not finite; give that of the step before, at first initial_state(N)")
    return found


def _drawn(logits: Array, rng: np.random.Generator) -> NDArray[np.int32]:
    """By the inverse of the cumulative distribution, in float64."""
    weights = np.exp(logits.astype(np.float64) - logits.max(1, keepdims=True))
    cumulative = weights.cumsum(1) / weights.sum(1, keepdims=True)
    drawn = (rng.random((len(logits), 1)) >= cumulative).sum(1)
    actions: NDArray[np.int32] = np.minimum(drawn, NUM_ACTIONS - 1).astype(np.int32)
    return actions
