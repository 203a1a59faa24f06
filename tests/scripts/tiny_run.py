# SPDX-License-Identifier: Apache-2.0
"""A training run so small that an update takes milliseconds, for tests of what happens to runs."""

CONFIG = """{top}
env:
  task: {{max_steps: 12}}
  observation: {{depth: false, camera: {{width_px: 40, height_px: 40}}}}
  acoustics: {{rays: 4, rir_length_s: 0.1, early_order: 0}}
policy: {{hidden_size: 8, visual_features: 8, audio_features: 8, conv_channels: 2}}
data:
  train: {{file: {folder}/train.json.gz, scenes: ["shoebox:6x3x5@0.3"], episodes_per_scene: 6, sounds: ["synth:noise"],
          filter: {{min_geodesic_m: 1, min_ratio: 1}}}}
  eval: {{file: {folder}/eval.json.gz, scenes: ["shoebox:6x3x5@0.3"], episodes_per_scene: 2, sounds: ["synth:noise"],
         filter: {{min_geodesic_m: 1, min_ratio: 1}}}}
"""


def config_text(folder: object, **top: object) -> str:
    """The config of a run whose episode sets lie in `folder`; top: the keys of its first level."""
    return CONFIG.format(top="\n".join(f"{key}: {value}" for key, value in top.items()), folder=folder)
