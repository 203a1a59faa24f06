# SPDX-License-Identifier: Apache-2.0
"""Configs of scenes.  Made by scripts/make_config_classes.py from `earshot config --json`."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Literal

from .._section import Section

if TYPE_CHECKING:
    CategoryObject = Literal["category", "object"]
    EnergyPressure = Literal["energy", "pressure"]
    ExactLegacySubstring = Literal["exact", "legacy_substring"]
    YZ = Literal["y", "z"]
else:  # OmegaConf 2.3 knows no Literal and no unions of lists
    CategoryObject = str
    EnergyPressure = str
    ExactLegacySubstring = str
    YZ = str


@dataclasses.dataclass(kw_only=True, slots=True)
class SceneRandomize(Section):
    """Random materials; {} takes the defaults. With candidates it implies semantics: indoor."""

    #: Seed of the materials. Range: 0 to 2^64 - 1.
    seed: int = 0
    #: Draws the material of each semantic category from its candidates. false: materials stay, with noise.
    candidates: bool = True
    #: What gets one draw. category: all surfaces of a semantic category. object: each object of the mesh.
    per: CategoryObject = "category"
    #: Absorption and scattering of each octave from 0 to 1, whatever the material. false: Gaussian noise on them.
    uniform: bool = False
    #: Standard deviation of the noise on absorption and scattering in each octave. No effect with uniform. Range: 0 to 1.
    noise_std: float = 0.05
    #: Correlation of the noise of neighbouring octaves. Range: 0 to 1.
    noise_correlation: float = 0.0
    #: Standard deviation of the noise on transmission losses. Range: 0 to 60.
    transmission_noise_db: float = 3.0


@dataclasses.dataclass(kw_only=True, slots=True)
class Air(Section):
    """State of the air: speed of sound and absorption."""

    #: Temperature. Range: -20 to 50.
    temperature_c: float = 20.0
    #: Relative humidity. Range: 0 to 100.
    humidity_percent: float = 50.0
    #: Atmospheric pressure. Range: 50 to 120.
    pressure_kpa: float = 101.325
    #: Speed of sound. 0: from the temperature (ISO 9613-1). Range: 100 to 2,000, or 0.
    speed_of_sound_m_per_s: float = 0.0


@dataclasses.dataclass(kw_only=True, slots=True)
class SceneConfig(Section):
    """A mesh with its materials and air, a SCENE of every command; configs/scenes."""

    #: Version of the file format; a program refuses versions that it does not know. Range: 1.
    schema_version: int = 1
    #: Geometry of the scene. Range: a mesh file, relative to this file, shoebox:..., house:... or floor:....
    mesh: str
    #: Axis of the mesh file that points up. Absent: y, or z for a LAS file.
    up: YZ | None = None
    #: Length of one unit of the mesh file. Range: 0.000001 to 1,000,000. Absent: 1, with a warning where the sizes tell otherwise.
    unit_m: float | None = None
    #: Edge of the voxels of a point cloud. Absent: from the spacing of its points. Range: 0.001 to 10.
    cell_m: float | None = None
    #: Height of a lid over the bounding rectangle, called ceiling_lid. Absent: no lid.
    ceiling_m: float | None = None
    #: Distance by which surfaces may move to save triangles. Absent: no simplification. Range: above 0 and at most 1.
    simplify_m: float | None = None
    #: Categories of the surfaces of a scanned mesh. Absent: the file beside the mesh that the data set calls so. Range: a .house,
    #: an info_semantic.json or a .semantic.txt, relative to this file.
    annotations: str | None = None
    #: Material database (JSON). Absent: the built-in one. Range: a material database.
    materials: str | None = None
    #: Meaning of the numbers of materials; default: what that file says, else energy.
    coefficients: EnergyPressure | None = None
    #: Materials by pattern over mesh-material and node names, an exact name first.
    assign: dict[str, str] = dataclasses.field(default_factory=dict)
    #: Material of what no pattern matches. Range: the name of a material.
    default_material: str | None = None
    #: Materials by semantic category of mesh-material and node names. Absent: categories have no effect. Range: indoor, or a file
    #: as configs/semantic_materials.yaml.
    semantics: str | None = None
    #: Match of the labels of a material database. exact: whole words. legacy_substring: as SoundSpaces.
    label_matching: ExactLegacySubstring = "exact"
    #: Random materials; {} takes the defaults. With candidates it implies semantics: indoor.
    randomize: SceneRandomize | None = None
    #: State of the air: speed of sound and absorption.
    air: Air = dataclasses.field(default_factory=Air)
    #: Surfaces reflect from both sides; true is the only value.
    two_sided: bool = True
