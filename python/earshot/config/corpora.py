# SPDX-License-Identifier: Apache-2.0
"""Configs of corpora.  Made by scripts/make_config_classes.py from `earshot config --json`."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, Literal

from .._section import Section
from .acoustics import CorpusAcoustics

if TYPE_CHECKING:
    CategoryObject = Literal["category", "object"]
    FlacWav = Literal["flac", "wav"]
    TextOrList = str | list[str]
else:  # OmegaConf 2.3 knows no Literal and no unions of lists
    CategoryObject = str
    FlacWav = str
    TextOrList = Any


@dataclasses.dataclass(kw_only=True, slots=True)
class Shoeboxes(Section):
    """Empty rooms of random size and absorption."""

    #: Number of rooms. Range: 0 to 10,000,000.
    count: int = 0
    #: Smallest size along x, y (height) and z. Range: 3 numbers, 1 to 1,000.
    min_size_m: list[float] = dataclasses.field(default_factory=lambda: [3.0, 2.4, 3.0])
    #: Largest size along x, y (height) and z. Range: 3 numbers, 1 to 1,000.
    max_size_m: list[float] = dataclasses.field(default_factory=lambda: [10.0, 4.0, 8.0])
    #: Absorption coefficients, one for each wall; uniform in the logarithm. Range: least and largest, 0.001 to 1.
    absorption: list[float] = dataclasses.field(default_factory=lambda: [0.05, 0.5])
    #: Materials of the walls, one drawn for each. Empty: absorption decides. Range: the name of a material.
    walls: list[str] = dataclasses.field(default_factory=list)
    #: Materials of the floor. Empty: absorption decides. Range: the name of a material.
    floor: list[str] = dataclasses.field(default_factory=list)
    #: Materials of the ceiling. Empty: absorption decides. Range: the name of a material.
    ceiling: list[str] = dataclasses.field(default_factory=list)


@dataclasses.dataclass(kw_only=True, slots=True)
class Randomize(Section):
    """Random materials in every room; {} takes the defaults, with the noise of SoundSpaces 2.0."""

    #: Draws the material of each semantic category from its candidates. false: materials stay, with noise.
    candidates: bool = True
    #: What gets one draw. category: all surfaces of a semantic category. object: each object of the mesh.
    per: CategoryObject = "category"
    #: Absorption and scattering of each octave from 0 to 1, whatever the material. false: Gaussian noise on them.
    uniform: bool = False
    #: Standard deviation of the noise on absorption and scattering in each octave. No effect with uniform. Range: 0 to 1.
    noise_std: float = 0.1
    #: Correlation of the noise of neighbouring octaves. Range: 0 to 1.
    noise_correlation: float = 0.0
    #: Standard deviation of the noise on transmission losses. Range: 0 to 60.
    transmission_noise_db: float = 3.0


@dataclasses.dataclass(kw_only=True, slots=True)
class Panorama(Section):
    """Panoramas of colour, depth and category from the places of the listeners."""

    #: Width, over 360 degrees. Range: 8 to 4,096.
    width_px: int = 1152
    #: Height; without views at most half of the width. Range: 4 to 2,048.
    height_px: int = 384
    #: Pinhole pictures side by side that make up the panorama, of 360 / views degrees each. 0: one picture, uniform in angle.
    #: Range: 0 to 360.
    views: int = 0


@dataclasses.dataclass(kw_only=True, slots=True)
class ResponseCorpusConfig(Section):
    """A corpus of room impulse responses, read by earshot dataset rir; configs/datasets/rir.yaml."""

    #: Version of the file format; a program refuses versions that it does not know. Range: 1.
    schema_version: int = 1
    #: Seed of the corpus. Range: 0 to 2^64 - 1.
    seed: int = 0
    #: Empty rooms of random size and absorption.
    shoeboxes: Shoeboxes = dataclasses.field(default_factory=Shoeboxes)
    #: Scenes (house:0..99 stands for a hundred), or folders of meshes and scene YAMLs. Range: a SCENE or a folder.
    scenes: list[str] = dataclasses.field(default_factory=list)
    #: Number of times that each scene comes; with randomize each time with other materials. Range: 1 to 1,000,000.
    rooms_per_scene: int = 1
    #: Random materials in every room; {} takes the defaults, with the noise of SoundSpaces 2.0.
    randomize: Randomize | None = None
    #: Sources in each room. Range: 1 to 65,000.
    sources_per_room: int = 4
    #: Listeners of each source. Range: 1 to 65,000.
    listeners_per_source: int = 25
    #: All sources of a room have the same listeners, which mixtures need.
    shared_listeners: bool = False
    #: Height of sources above the floor. Range: least and largest, 0.05 to 100.
    source_height_m: list[float] = dataclasses.field(default_factory=lambda: [1.1, 1.8])
    #: Height of listeners above the floor. Range: least and largest, 0.05 to 100.
    listener_height_m: list[float] = dataclasses.field(default_factory=lambda: [1.1, 1.8])
    #: Distance of places from walls, furniture and the ceiling. Range: 0.05 to 10.
    clearance_m: float = 0.3
    #: Shortest distance from source to listener. Range: at least 0.
    min_distance_m: float = 0.5
    #: Longest distance from source to listener. Range: above 0.
    max_distance_m: float = 1000.0
    #: Largest difference in height between source and listener. Range: above 0.
    max_height_difference_m: float = 1000.0
    #: Directional patterns, one drawn for each source, which faces anywhere. Range: a directional pattern.
    source_patterns: list[str] = dataclasses.field(default_factory=lambda: ["omni"])
    #: Pitch of listeners; headings are anywhere. Range: least and largest, -90 to 90.
    pitch_deg: list[float] = dataclasses.field(default_factory=lambda: [0.0, 0.0])
    #: Roll of listeners. Range: least and largest, -180 to 180.
    roll_deg: list[float] = dataclasses.field(default_factory=lambda: [0.0, 0.0])
    #: Reverberation times (t20_mid_s): rooms are drawn again until each tenth of the range comes equally often. [0, 0]: as the
    #: rooms. Range: least and largest, 0 to 100.
    rt60_s: list[float] = dataclasses.field(default_factory=lambda: [0.0, 0.0])
    #: Direct-to-reverberant ratios: listeners are drawn again in the same way. [0, 0]: as the places. Range: least and largest,
    #: -100 to 100.
    drr_db: list[float] = dataclasses.field(default_factory=lambda: [0.0, 0.0])
    #: Channels: mono[:PATTERN], stereo[:xy|:ms|:ab|:ortf], binaural, quad, surround_5_1, surround_7_1,
    #: ambisonic:ORDER[:n3d|:sn3d][:world|:ego] or array:FILE. Range: channels as of earshot rir.
    channels: str = "binaural"
    #: SOFA file with HRTFs for binaural channels. Empty: a rigid sphere of radius 8.75 cm. Range: a SOFA file.
    hrtf: str = ""
    #: SOFA files with HRTFs, one drawn for each listener; at most 1,000. Empty: hrtf for all. Range: a SOFA file, or sphere.
    hrtfs: list[str] = dataclasses.field(default_factory=list)
    #: Format of sound files: 32-bit WAV, or FLAC of at most 8 channels.
    format: FlacWav = "wav"
    #: One SOFA file (SingleRoomSRIR) per source in place of sound files.
    sofa: bool = False
    #: Time after the direct sound at which a response is split into an early and a late file. 0: no split. Range: at least 0.
    split_ms: float = 0.0
    #: Standard errors of t20_s in the manifest. Costs at least one more trace per response, nothing with a field.
    stated_errors: bool = False
    #: Panoramas of colour, depth and category from the places of the listeners.
    panorama: Panorama | None = None
    #: Rooms in each folder of the corpus. Range: 1 to 10,000.
    rooms_per_folder: int = 10
    #: Simulation of responses: a preset, and keys over it.
    acoustics: CorpusAcoustics = dataclasses.field(default_factory=CorpusAcoustics)


@dataclasses.dataclass(kw_only=True, slots=True)
class RecordingCorpusConfig(Section):
    """Recordings of sound scenes with labels, read by earshot dataset scenes; configs/datasets/scenes.yaml."""

    #: Version of the file format; a program refuses versions that it does not know. Range: 1.
    schema_version: int = 1
    #: Seed of the corpus. Range: 0 to 2^64 - 1.
    seed: int = 0
    #: Empty rooms of random size and absorption.
    shoeboxes: Shoeboxes = dataclasses.field(default_factory=Shoeboxes)
    #: Scenes (house:0..99 stands for a hundred), or folders of meshes and scene YAMLs. Range: a SCENE or a folder.
    scenes: list[str] = dataclasses.field(default_factory=list)
    #: Number of times that each scene comes; with randomize each time with other materials. Range: 1 to 1,000,000.
    rooms_per_scene: int = 1
    #: Random materials in every room; {} takes the defaults, with the noise of SoundSpaces 2.0.
    randomize: Randomize | None = None
    #: Height of sources above the floor. Range: least and largest, 0.05 to 100.
    source_height_m: list[float] = dataclasses.field(default_factory=lambda: [1.1, 1.8])
    #: Height of listeners above the floor. Range: least and largest, 0.05 to 100.
    listener_height_m: list[float] = dataclasses.field(default_factory=lambda: [1.1, 1.8])
    #: Distance of places from walls, furniture and the ceiling. Range: 0.05 to 10.
    clearance_m: float = 0.3
    #: Shortest distance from source to listener. Range: at least 0.
    min_distance_m: float = 0.5
    #: Longest distance from source to listener. Range: above 0.
    max_distance_m: float = 1000.0
    #: Directional patterns, one drawn for each source, which faces anywhere. Range: a directional pattern.
    source_patterns: list[str] = dataclasses.field(default_factory=lambda: ["omni"])
    #: Pitch of listeners; headings are anywhere. Range: least and largest, -90 to 90.
    pitch_deg: list[float] = dataclasses.field(default_factory=lambda: [0.0, 0.0])
    #: Roll of listeners. Range: least and largest, -180 to 180.
    roll_deg: list[float] = dataclasses.field(default_factory=lambda: [0.0, 0.0])
    #: Channels: mono[:PATTERN], stereo[:xy|:ms|:ab|:ortf], binaural, quad, surround_5_1, surround_7_1,
    #: ambisonic:ORDER[:n3d|:sn3d][:world|:ego] or array:FILE. Range: channels as of earshot rir.
    channels: str = "binaural"
    #: SOFA file with HRTFs for binaural channels. Empty: a rigid sphere of radius 8.75 cm. Range: a SOFA file.
    hrtf: str = ""
    #: Format of sound files: 32-bit WAV, or FLAC of at most 8 channels.
    format: FlacWav = "wav"
    #: Rooms in each folder of the corpus. Range: 1 to 10,000.
    rooms_per_folder: int = 10
    #: Simulation of responses: a preset, and keys over it.
    acoustics: CorpusAcoustics = dataclasses.field(default_factory=CorpusAcoustics)
    #: Recordings in each room. Range: 1 to 10,000.
    recordings_per_room: int = 4
    #: Duration of a recording. Range: 0.2 to 600.
    duration_s: float = 10.0
    #: Classes of sounds by name; their order is their index.
    classes: dict[str, TextOrList] = dataclasses.field(default_factory=dict)
    #: Sound events of a recording, before max_overlap leaves some out. Range: least and largest, 1 to 100.
    events: list[int] = dataclasses.field(default_factory=lambda: [2, 6])
    #: Duration of an event, at most duration_s; a sound loops. Range: least and largest, 0.1 to 600.
    event_s: list[float] = dataclasses.field(default_factory=lambda: [1.0, 4.0])
    #: Largest number of events at the same time. Range: 1 to 100.
    max_overlap: int = 2
    #: Fraction of the events whose source moves. Range: 0 to 1.
    moving: float = 0.5
    #: Speed of moving sources. Range: least and largest, 0.01 to 10.
    speed_m_per_s: list[float] = dataclasses.field(default_factory=lambda: [0.3, 1.5])
    #: Level of an event's dry sound relative to the others. Range: least and largest, -60 to 60.
    event_db: list[float] = dataclasses.field(default_factory=lambda: [-6.0, 6.0])
    #: Background noise, unrelated between channels. Empty: none. Range: synth, or a folder.
    noise: str = ""
    #: Level of all events over the noise. Range: least and largest, -60 to 120.
    snr_db: list[float] = dataclasses.field(default_factory=lambda: [10.0, 30.0])
    #: Level of a recording. Range: least and largest, -100 to 0.
    level_dbfs: list[float] = dataclasses.field(default_factory=lambda: [-35.0, -25.0])
    #: Leave out sound files that cannot be decoded or are silent, as inputs.jsonl lists them. false: such a file is refused.
    skip_bad: bool = False
