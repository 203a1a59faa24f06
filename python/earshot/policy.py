# SPDX-License-Identifier: Apache-2.0
"""Trained policies outside the trainer: numpy alone, or exported to ONNX."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._configs import FOLDER, PREFIX
from ._engine import InputError
from ._network import NUM_ACTIONS, Architecture, Array, Network, Sensor
from ._policy_file import read_policy_file

Observations = Mapping[str, Any]


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

    Logits differ from those of the program by rounding (at most 1e-5 of their size).  One thread at a time.
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
        return Policy(read_policy_file(_file_of(path)), str(path))

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
        return np.zeros((num_envs, self._architecture.hidden_size), np.float32)

    def step(self, observations: Observations, state: Array) -> tuple[Array, Array, Array]:
        """One step of N envs, of which the caller keeps the state.

        observations: arrays [N, ...] by name; others than those of observation_shapes are not read.  state: [N, H], zero where an episode
        begins.  Returns logits [N, 4] (stop, forward, left, right), values [N] and the next state.  Raises InputError for an observation
        that is missing, has another shape or is not finite.
        """
        rows = {sensor.name: self._rows(sensor, observations) for sensor in self._architecture.sensors}
        sizes = {name: len(array) for name, array in rows.items()} | {"state": len(state)}
        if len(set(sizes.values())) != 1:
            raise InputError(f"observations: have different numbers of rows, {sizes}; give all of them those of the same envs")
        if state.shape[1:] != (self._architecture.hidden_size,):
            raise InputError(f"state: has the shape {state.shape}; start with initial_state({len(state)})")
        return self._network.step(rows, state)

    def act(self, observations: Observations, begins: Any = None, *, sample: bool = False, rng: np.random.Generator | None = None) -> Any:
        """One action per env; the policy keeps its state from call to call.

        observations: as in step(), or of a single env without the first dimension; then the result is one int.  begins: [N] bool, true
        where these observations are the first of an episode; None: where the number of envs differs from the call before, all, else
        none.  sample: draws from the policy's distribution by rng (default: a fresh generator) in place of the likeliest action.
        """
        first = self._architecture.sensors[0]
        single = np.ndim(observations.get(first.name, 0)) == len(first.shape)
        if single:
            observations = {name: np.asarray(array)[None] for name, array in observations.items() if name in self.observation_shapes}
        count = len(self._rows(first, observations))
        if self._state is None or len(self._state) != count:
            self._state = self.initial_state(count)
        if begins is not None:
            mask = np.atleast_1d(np.asarray(begins, bool))
            if mask.shape != (count,):
                raise InputError(f"begins: has the shape {mask.shape}; give one bool for each of {count} envs")
            self._state = np.where(mask[:, None], np.float32(0), self._state)
        logits, _, self._state = self.step(observations, self._state)
        actions = _drawn(logits, rng or np.random.default_rng()) if sample else logits.argmax(1).astype(np.int32)
        return int(actions[0]) if single else actions

    def to_onnx(self, path: str | Path) -> None:
        """Writes the network as an ONNX model (needs the package onnx; extra `onnx`).

        Inputs: the observations [N, ...] by name, and "state" [N, H], zero where an episode begins.  Outputs: "logits" [N, 4],
        "next_state" [N, H], and "value" [N] if has_value.
        """
        from ._onnx import write_onnx

        write_onnx(self._architecture, self.weights, Path(path))

    def _rows(self, sensor: Sensor, observations: Observations) -> NDArray[Any]:
        if sensor.name not in observations:
            raise InputError(
                f"observations: have no '{sensor.name}', which the policy reads; it reads {', '.join(self.observation_shapes)}"
            )
        array = np.asarray(observations[sensor.name])
        if array.shape[1:] != sensor.shape or array.ndim != len(sensor.shape) + 1:
            wanted = "x".join(["N", *map(str, sensor.shape)])
            raise InputError(f"observation '{sensor.name}': has the shape {'x'.join(map(str, array.shape))}; the policy reads {wanted}")
        if array.dtype.kind not in "fiub" or (array.dtype.kind == "f" and not np.isfinite(array).all()):
            raise InputError(f"observation '{sensor.name}': has values that are no finite numbers")
        if sensor.kind == "previous_action" and array.size and not (array.min() >= -1 and array.max() < NUM_ACTIONS):
            raise InputError(f"observation '{sensor.name}': has values outside -1 (none) to {NUM_ACTIONS - 1}")
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


def _file_of(path: str | Path) -> Path:
    if not str(path).startswith(PREFIX):
        return Path(path)
    known = {f"{PREFIX}policies/{file.stem}": file for file in sorted((FOLDER / "policies").glob("*.policy"))}
    if str(path) not in known:
        raise InputError(f"{path}: the package has no such policy; it has {', '.join(known)}")
    return known[str(path)]


def _drawn(logits: Array, rng: np.random.Generator) -> NDArray[np.int32]:
    """By the inverse of the cumulative distribution, in float64."""
    weights = np.exp(logits.astype(np.float64) - logits.max(1, keepdims=True))
    cumulative = weights.cumsum(1) / weights.sum(1, keepdims=True)
    drawn = (rng.random((len(logits), 1)) >= cumulative).sum(1)
    actions: NDArray[np.int32] = np.minimum(drawn, NUM_ACTIONS - 1).astype(np.int32)
    return actions
