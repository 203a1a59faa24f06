# SPDX-License-Identifier: Apache-2.0
"""Batches in the forms that training frameworks take, and runs and episodes for trackers and viewers; each module imports its package.

stable_baselines3: EarshotVecEnv.  torchrl: EarshotTorchRLEnv.  rllib: register, make_rllib_vec.  pufferlib: EarshotPufferEnv.
runs: follow, points.  tracking: WandbLogger, MlflowLogger, TensorBoardLogger, log_run.  rerun: export.
grid: responses of a grid by points and headings.  habitat: standalone, register, get_config, make_env, AudioSensor.
sample_factory: register, EarshotSampleFactoryEnv.  Gymnasium, CleanRL, PettingZoo and SuperSuit take what earshot.make_vec and
earshot.parallel_env return.
"""
