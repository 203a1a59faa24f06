# SPDX-License-Identifier: Apache-2.0
"""Batches in the forms that training frameworks take; each module imports its framework.

stable_baselines3: EarshotVecEnv.  torchrl: EarshotTorchRLEnv.  rllib: register, make_rllib_vec.  pufferlib: EarshotPufferEnv.
sample_factory: register, EarshotSampleFactoryEnv.  Gymnasium, CleanRL, PettingZoo and SuperSuit take what earshot.make_vec and
earshot.parallel_env return.
"""
