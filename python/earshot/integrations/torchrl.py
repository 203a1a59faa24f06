# SPDX-License-Identifier: Apache-2.0
"""A batch as an environment of TorchRL with its specs::

from earshot.integrations.torchrl import EarshotTorchRLEnv

env = EarshotTorchRLEnv("earshot:train/quick", 16, threads=0)     # batch_size [16]
data = env.rollout(100, policy, break_when_any_done=False)        # [16, 100]
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .._configs import Config
from .._seeds import own_sequence, seeds_from, spread_seeds
from ..vector import EarshotVectorEnv
from ._common import require

torch = require("torch", "torchrl")
require("torchrl", "torchrl")

from tensordict import TensorDict, TensorDictBase  # noqa: E402
from torchrl.data import Bounded, Categorical, Composite, Unbounded  # noqa: E402
from torchrl.envs import EnvBase  # noqa: E402

METRICS = ("success", "spl", "soft_spl", "distance_to_goal_m", "episode_return", "steps")


class EarshotTorchRLEnv(EnvBase):
    """Arguments are those of earshot.make_vec.  TorchRL resets the envs that ended by their "_reset" mask.

    Keys: one per sensor, "action" (integers [num_envs]), "reward", "done", "terminated", "truncated" ([num_envs, 1]), and
    ("metrics", NAME) with the metrics of an episode where "done" is set, 0 elsewhere.  "quarantined" [num_envs, 1] is True where an
    episode was faulty; do not train on it.  Tensors are copies.
    """

    def __init__(self, config: Config, num_envs: int = 1, *, device: Any = "cpu", first_env: int | None = None, **arguments: Any) -> None:
        super().__init__(device=torch.device(device), batch_size=torch.Size([num_envs]))
        first = 0 if first_env is None else first_env
        self.envs = EarshotVectorEnv(config, num_envs, autoreset_mode="disabled", copy=True, first_env=first, **arguments)
        self._has_own_sequence = first_env is None
        self._seeds_of_reset: list[int] | None = None
        boxes: Any = self.envs.observation_space
        sensors = {name: self._spec_of(box) for name, box in boxes.spaces.items()}
        metrics = Composite({name: self._column(torch.float32) for name in METRICS}, shape=self.batch_size)
        flag = Categorical(2, shape=(num_envs, 1), device=self.device, dtype=torch.bool)
        self.observation_spec = Composite({**sensors, "metrics": metrics, "quarantined": flag.clone()}, shape=self.batch_size)
        self.action_spec = Categorical(4, shape=self.batch_size, device=self.device, dtype=torch.int64)
        self.reward_spec = self._column(torch.float32)
        self.done_spec = Composite({name: flag.clone() for name in ("done", "terminated", "truncated")}, shape=self.batch_size)

    def _spec_of(self, box: Any) -> Any:
        dtype = torch.from_numpy(np.empty(0, box.dtype)).dtype
        if np.isfinite(box.low).all() and np.isfinite(box.high).all():
            low, high = torch.from_numpy(box.low.copy()), torch.from_numpy(box.high.copy())
            return Bounded(low=low, high=high, shape=box.shape, dtype=dtype, device=self.device)
        return Unbounded(shape=box.shape, dtype=dtype, device=self.device)

    def _column(self, dtype: Any) -> Any:
        return Unbounded(shape=(*self.batch_size, 1), dtype=dtype, device=self.device)

    def _reset(self, tensordict: TensorDictBase | None = None, **_: Any) -> TensorDictBase:
        mask = None if tensordict is None else tensordict.get("_reset", None)
        options: dict[str, Any] | None = None
        if mask is not None and not mask.all() and self.envs.started:
            options = {"reset_mask": mask.reshape(-1).cpu().numpy()}
        if self._seeds_of_reset is None and self._has_own_sequence and not self.envs.started:
            first = own_sequence(self.envs.batch.config_text)
            self._seeds_of_reset = None if first is None else seeds_from(first, self.envs.num_envs)
        observations, _ = self.envs.reset(seed=self._seeds_of_reset, options=options)
        self._seeds_of_reset = None
        no_ends = np.zeros(self.envs.num_envs, dtype=np.bool_)
        return self._tensors(observations, {}, no_ends, no_ends)

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        actions = tensordict["action"].reshape(-1).cpu().numpy()
        observations, rewards, terminated, truncated, infos = self.envs.step(actions)
        data = self._tensors(observations, infos, terminated, truncated)
        data["reward"] = torch.from_numpy(rewards).unsqueeze(-1).to(self.device)
        return data

    def _set_seed(self, seed: int | None) -> None:
        """The next reset begins the episodes of spread_seeds."""
        self._seeds_of_reset = None if seed is None else spread_seeds(seed, self.envs.num_envs, self.envs.first_env, "set_seed")

    def _tensors(self, observations: Any, infos: dict[str, Any], terminated: Any, truncated: Any) -> TensorDictBase:
        zeros = np.zeros(self.envs.num_envs, dtype=np.float32)
        metrics = {name: torch.from_numpy(np.asarray(infos.get(name, zeros), dtype=np.float32)).unsqueeze(-1) for name in METRICS}
        quarantined = infos.get("quarantined", np.zeros(self.envs.num_envs, dtype=np.bool_))
        flags = {"done": terminated | truncated, "terminated": terminated, "truncated": truncated, "quarantined": quarantined}
        source = {
            **{name: torch.from_numpy(array) for name, array in observations.items()},
            **{name: torch.from_numpy(flag.copy()).unsqueeze(-1) for name, flag in flags.items()},
            "metrics": TensorDict(metrics, batch_size=self.batch_size),
        }
        return TensorDict(source, batch_size=self.batch_size, device=self.device)

    def close(self, *, raise_if_closed: bool = True) -> None:
        self.envs.close()
        super().close(raise_if_closed=raise_if_closed)
