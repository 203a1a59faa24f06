# SPDX-License-Identifier: Apache-2.0
"""Configs of environments.  Made by scripts/make_config_classes.py from `earshot config --json`."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Literal

from .._section import Section
from .acoustics import Acoustics

if TYPE_CHECKING:
    AllocentricEgocentric = Literal["allocentric", "egocentric"]
    AutoEglEmbree = Literal["auto", "egl", "embree"]
    ContinuousGrid = Literal["continuous", "grid"]
    EquirectangularPinhole = Literal["equirectangular", "pinhole"]
    NextStepOffSameStep = Literal["next_step", "off", "same_step"]
    OnceRandom = Literal["once", "random"]
else:  # OmegaConf 2.3 knows no Literal and no unions of lists
    AllocentricEgocentric = str
    AutoEglEmbree = str
    ContinuousGrid = str
    EquirectangularPinhole = str
    NextStepOffSameStep = str
    OnceRandom = str


@dataclasses.dataclass(kw_only=True, slots=True)
class ActuationNoise(Section):
    """Gaussian errors of every step, as standard deviations; 0: none."""

    #: Error of the distance of forward; at most a third of it. Range: at least 0.
    forward_m: float = 0.0
    #: Error of the angle of left and right. Range: 0 to 45.
    turn_deg: float = 0.0
    #: Angle by which forward changes the heading. Range: 0 to 45.
    veer_deg: float = 0.0


@dataclasses.dataclass(kw_only=True, slots=True)
class Task(Section):
    """Rules of an episode: actions, rewards and its end."""

    #: Motion of the agent. continuous: it slides along obstacles. grid: it makes the whole step or none.
    motion: ContinuousGrid = "continuous"
    #: Duration of a step, of every action; a whole number of samples of sound. Range: 0.001 to 10.
    step_time_s: float = 0.15
    #: Distance of the action forward. Range: 0.01 to 10.
    forward_m: float = 0.15
    #: Angle of the actions left and right; it divides 360. Range: 0.1 to 180.
    turn_deg: float = 10.0
    #: Geodesic distance to the goal within which a stop is a success. Range: 0.01 to 100.
    success_radius_m: float = 1.0
    #: Steps after which an episode is truncated. Range: 1 to 1,000,000.
    max_steps: int = 500
    #: Reward of every step.
    step_reward: float = -0.01
    #: Reward per metre by which a step shortens the geodesic distance to the goal.
    distance_reward: float = 1.0
    #: Reward of a stop within success_radius_m of the goal.
    success_reward: float = 10.0
    #: Height of the ears above the floor. Range: 0.05 to 10.
    ear_height_m: float = 1.5
    #: Height of sources above the floor. Range: 0.05 to 10.
    source_height_m: float = 1.5
    #: Gaussian errors of every step, as standard deviations; 0: none.
    actuation_noise: ActuationNoise = dataclasses.field(default_factory=ActuationNoise)


@dataclasses.dataclass(kw_only=True, slots=True)
class Camera(Section):
    """Main camera of the agent: level, ahead, a pinhole."""

    #: Width of its pictures. Range: 8 to 4,096, a multiple of 8.
    width_px: int = 128
    #: Height of its pictures. Range: 1 to 4,096.
    height_px: int = 128
    #: Horizontal field of view. Range: above 1 and below 179.
    horizontal_fov_deg: float = 90.0
    #: Height above the floor. Range: above 0 and below 10.
    height_m: float = 1.25
    #: Distance that depth is divided by and clipped to. Range: above 0.
    max_depth_m: float = 10.0


@dataclasses.dataclass(kw_only=True, slots=True)
class MountedCamera(Section):
    """A further camera, with at least one of depth, rgb, semantic and normals."""

    #: Depth picture, [H, W, 1] floats of max_depth_m.
    depth: bool = False
    #: Colour picture, [H, W, 3] bytes.
    rgb: bool = False
    #: Picture of the semantic category numbers, [H, W, 1].
    semantic: bool = False
    #: Picture of the surface normals, [H, W, 3] floats.
    normals: bool = False
    #: Width of its pictures. Range: 1 to 4,096.
    width_px: int = 128
    #: Height of its pictures. Range: 1 to 4,096.
    height_px: int = 128
    #: Projection: a pinhole camera, or a panorama with equal angles per pixel.
    projection: EquirectangularPinhole = "pinhole"
    #: Angle over the width; of a pinhole above 1 and below 179. Range: 1 to 360.
    horizontal_fov_deg: float = 90.0
    #: Place of the camera to the right of the agent. Range: -10 to 10.
    right_m: float = 0.0
    #: Place of the camera above the floor. Range: -10 to 10.
    up_m: float = 1.25
    #: Place of the camera ahead of the agent. Range: -10 to 10.
    forward_m: float = 0.0
    #: Direction of the camera to the left of the agent's heading. Range: -360 to 360.
    yaw_deg: float = 0.0
    #: Direction of the camera upwards. Range: -90 to 90.
    pitch_deg: float = 0.0
    #: Distance that depth is divided by and clipped to. Range: above 0.
    max_depth_m: float = 10.0
    #: Colours without light.
    unlit: bool = False


@dataclasses.dataclass(kw_only=True, slots=True)
class Noise(Section):
    """Noise of depth and of pose sensors."""

    #: Standard deviation of the matched shift of depth. Range: 0 to 1.
    disparity_px: float = 0.027778
    #: Standard deviation of the place of edges in depth. Range: 0 to 4.
    jitter_px: float = 0.25
    #: Step of the matched shift of depth. 0: none. Range: 0 to 1.
    quantum_px: float = 0.125
    #: Standard deviation of the position in gps_compass and pose, along each axis. Range: 0 to 10.
    position_m: float = 0.0
    #: Standard deviation of the heading in gps_compass and pose. Range: 0 to 180.
    heading_deg: float = 0.0


@dataclasses.dataclass(kw_only=True, slots=True)
class Map(Section):
    """Picture of topdown_map."""

    #: Width and height of the map. Range: 8 to 1,024.
    size_px: int = 64
    #: Edge of a pixel in the scene; above 0.3 m walls between rooms may be missed. Range: 0.02 to 1.
    metres_per_px: float = 0.125
    #: Axes of the map. egocentric: agent in the middle, heading up. allocentric: fixed to the scene.
    frame: AllocentricEgocentric = "egocentric"
    #: A fourth channel that shows the goals; it gives the answer away.
    goal: bool = False


@dataclasses.dataclass(kw_only=True, slots=True)
class Observation(Section):
    """Sensors of the agents."""

    #: Depth picture of the main camera.
    depth: bool = True
    #: Colour picture of the main camera.
    rgb: bool = False
    #: Picture of semantic category numbers of the main camera.
    semantic: bool = False
    #: Picture of surface normals of the main camera.
    normals: bool = False
    #: Colours of the main camera without light.
    unlit: bool = False
    #: Renderer of pinhole cameras. embree: rays on the CPU, the same bits on every machine. egl: OpenGL. auto: egl where its device
    #: is hardware.
    renderer: AutoEglEmbree = "embree"
    #: Device of the renderer egl. auto: the first hardware. Range: auto, software, a number, a UUID or cuda:N.
    egl_device: str = "auto"
    #: Log-magnitude spectrogram of the last second, of each channel of the sound.
    spectrogram: bool = True
    #: Level, interaural level difference and interaural phase difference of the last second; needs channels binaural.
    interaural: bool = False
    #: Sound of the step, [channels, samples].
    waveform: bool = False
    #: Sound of the last second, [channels, samples].
    heard: bool = False
    #: Channels: mono[:PATTERN], stereo[:xy|:ms|:ab|:ortf], binaural, quad, surround_5_1, surround_7_1,
    #: ambisonic:ORDER[:n3d|:sn3d][:world|:ego] or array:FILE. Range: channels as of earshot rir.
    channels: str = "binaural"
    #: Distance and bearing of the goal.
    pointgoal: bool = False
    #: Metres ahead of and right of the start, and radians turned since.
    gps_compass: bool = False
    #: Values of gps_compass, and seconds since the start.
    pose: bool = False
    #: Whether the last step met an obstacle.
    collision: bool = False
    #: Last action; -1 before the first.
    previous_action: bool = False
    #: Map of the walkable surface, the path and the agent, set by map.
    topdown_map: bool = False
    #: Action of the oracle; privileged, for learners.
    oracle_action: bool = False
    #: Distances to the goal and bearings of the goal and the next corner; privileged, for learners.
    goal_state: bool = False
    #: Spectrogram of the new samples alone, zero-padded to a second, as in SoundSpaces 2.0.
    legacy_spectrogram: bool = False
    #: Main camera of the agent: level, ahead, a pinhole.
    camera: Camera = dataclasses.field(default_factory=Camera)
    #: Further cameras by name; their sensors are NAME_depth, NAME_rgb and so on.
    cameras: dict[str, MountedCamera] = dataclasses.field(default_factory=dict)
    #: Depth of all cameras has the noise of a structured-light camera, set by noise.
    depth_noise: bool = False
    #: Noise of depth and of pose sensors.
    noise: Noise = dataclasses.field(default_factory=Noise)
    #: Picture of topdown_map.
    map: Map = dataclasses.field(default_factory=Map)


@dataclasses.dataclass(kw_only=True, slots=True)
class Navmesh(Section):
    """Walkable surface and the agent's cylinder."""

    #: Radius of the agent's cylinder. Range: above 0 and at most 2.
    agent_radius_m: float = 0.1
    #: Height of the agent's cylinder. Range: above 0 and at most 10.
    agent_height_m: float = 1.5
    #: Height of a step that the agent climbs; below agent_height_m. Range: at least 0.
    max_climb_m: float = 0.2
    #: Steepest slope that the agent walks on. Range: at least 0 and below 90.
    max_slope_deg: float = 45.0
    #: Width of the voxels that the navmesh is built from. Range: 0.005 to 1.
    cell_size_m: float = 0.05
    #: Height of the voxels that the navmesh is built from. Range: 0.005 to 1.
    cell_height_m: float = 0.05
    #: Area of walkable surface below which an island is dropped, such as a table top. Range: at least 0 and below 1,000,000.
    min_region_area_m2: float = 0.5


@dataclasses.dataclass(kw_only=True, slots=True)
class Filter(Section):
    """Generated episodes that are kept."""

    #: Shortest geodesic distance from start to goal. Range: above 0.
    min_geodesic_m: float = 4.0
    #: Longest geodesic distance; at least min_geodesic_m. Range: above 0.
    max_geodesic_m: float = 100.0
    #: Least ratio of the geodesic to the straight distance. Range: 0 to 100.
    min_ratio: float = 1.1
    #: Attempts per episode before the filter counts as too strict. Range: 1 to 2,147,483,647.
    max_tries: int = 1000


@dataclasses.dataclass(kw_only=True, slots=True)
class Scenario(Section):
    """Onset, duration, distractors and noise of generated episodes."""

    #: Earliest onset of the goal's sound; at most onset_high_s. Range: at least 0.
    onset_low_s: float = 0.0
    #: Latest onset of the goal's sound, which is uniform. Range: 0 to 100,000.
    onset_high_s: float = 0.0
    #: Mean duration of the goal's sound, which is normal and at least 1 s. Negative: to the end of the episode. Range: at most
    #: 100,000.
    duration_mean_s: float = -1.0
    #: Standard deviation of the duration. Range: 0 to 100,000.
    duration_std_s: float = 0.0
    #: Other sounds at other places of the scene, which play throughout. Range: 0 to 63.
    distractors: int = 0
    #: Level of distractors over the level of their clips. Range: -60 to 60.
    distractor_level_db: float = 0.0
    #: Level of the goal's sound at 1 m over white noise at both ears. 200: no noise. Range: -200 to 200.
    noise_snr_db: float = 200.0


@dataclasses.dataclass(kw_only=True, slots=True)
class Agents(Section):
    """Agents of generated episodes."""

    #: Agents of an episode. Range: 1 to 16.
    count: int = 1
    #: Least straight distance between any two starts. Range: 0 to 100.
    apart_m: float = 1.0
    #: Sounds of the agents, drawn for each. Empty: agents are silent. Range: a sound.
    sounds: list[str] = dataclasses.field(default_factory=list)
    #: Level of the agents' sounds. Range: -60 to 60.
    level_db: float = 0.0


@dataclasses.dataclass(kw_only=True, slots=True)
class Episodes(Section):
    """Episodes of the environments: scenes and sounds, or a file."""

    #: Episode set (JSON or JSON.gz), relative to the working folder; made from the other keys where it is missing. Range: an
    #: episode set.
    file: str = ""
    #: Scenes of the episodes. A range stands for several: house:10..14,rooms=3 for five. Range: a SCENE.
    scenes: list[str] = dataclasses.field(default_factory=list)
    #: Sounds, drawn per episode: files, folders of files, or synth:KIND:SEED. synth:bird:0..3 stands for four. Range: a sound.
    sounds: list[str] = dataclasses.field(default_factory=list)
    #: Episodes generated in each scene. Range: 1 to 2,147,483,647.
    episodes_per_scene: int = 50
    #: Goals that the episodes of a scene share, far from each other. 0: each episode has its own goal. Range: 0 to 100,000.
    goals_per_scene: int = 0
    #: Seed of the generated episodes. Range: 0 to 2^64 - 1.
    seed: int = 0
    #: Generated episodes that are kept.
    filter: Filter = dataclasses.field(default_factory=Filter)
    #: Onset, duration, distractors and noise of generated episodes.
    scenario: Scenario = dataclasses.field(default_factory=Scenario)
    #: Agents of generated episodes.
    agents: Agents = dataclasses.field(default_factory=Agents)


@dataclasses.dataclass(kw_only=True, slots=True)
class EnvConfig(Section):
    """Environments without a training, read by Python's make_vec and earshot bench bits."""

    #: Version of the file format; a program refuses versions that it does not know. Range: 1.
    schema_version: int = 1
    #: Rules of an episode: actions, rewards and its end.
    task: Task = dataclasses.field(default_factory=Task)
    #: Errors that responses may have; a planner chooses the cheapest acoustics within them. Empty: acoustics decides. Range:
    #: errors, for example t20=10%,drr=2dB.
    accuracy: str = ""
    #: Simulation of responses: a preset, and keys over it.
    acoustics: Acoustics = dataclasses.field(default_factory=Acoustics)
    #: Sensors of the agents.
    observation: Observation = dataclasses.field(default_factory=Observation)
    #: Walkable surface and the agent's cylinder.
    navmesh: Navmesh = dataclasses.field(default_factory=Navmesh)
    #: SOFA file with HRTFs, for observation.channels binaural. Empty: a rigid sphere of radius 8.75 cm. Range: a SOFA file.
    hrtf: str = ""
    #: Folder of sounds that an episode set names without a path. Range: a folder.
    sound_root: str = ""
    #: Factor on the dry sound. 12.566371 (4 pi) makes a source as loud at 1 m as its dry clip. Range: above 0.
    sound_gain: float = 1.0
    #: Duration of the fade from one response to the next; at most task.step_time_s. Range: at least 0.
    crossfade_s: float = 0.05
    #: Restarts the sounds at every step, without the reverberation of the steps before; for comparison.
    sound_restarts: bool = False
    #: Agents in each environment. Range: 1 to 16.
    agents: int = 1
    #: Order of episodes. random: drawn without end. once: each of the set once.
    order: OnceRandom = "random"
    #: Start of the next episode. same_step: in the step that ends one. next_step: in the step after. off: by reset() only.
    autoreset: NextStepOffSameStep | None = None
    #: Threads of the batch. 0: all cores. Range: 0 to 1,024.
    threads: int | None = None
    #: Time after which a stage of an environment is given up and its episode quarantined. 0: no limit. Range: 0 to 1,000,000.
    stage_limit_s: float = 0.0
    #: Seed of episodes and noise; in a run config the default is the seed of the run. Range: 0 to 2^64 - 1.
    seed: int = 0
    #: Folder of relative scene files. Range: a folder.
    scene_root: str = ""
    #: Memory for loaded scenes, of each process. Range: at least 0.
    scene_cache_gb: float = 4.0
    #: Loads the scene and source of an environment's next episode in the background.
    prefetch: bool = True
    #: Folder of source fields that all processes and runs share. Empty: folder fields of a run, otherwise in memory only. Range: a
    #: folder.
    field_store: str = ""
    #: Size of field_store; the least recently used fields are removed first. Range: 0 to 1,000,000,000.
    field_store_gb: float = 20.0
    #: Folder of preprocessed scenes that all processes and runs share. Empty: each process loads them. Range: a folder.
    scene_store: str = ""
    #: Size of scene_store; the least recently used scenes are removed first. Range: 0 to 1,000,000,000.
    scene_store_gb: float = 20.0
    #: Folder for files of quarantined episodes, which earshot replay runs again. Empty: folder quarantine of a run, otherwise none.
    #: Range: a folder.
    quarantine_dir: str = ""
    #: Episodes of the environments: scenes and sounds, or a file.
    episodes: Episodes = dataclasses.field(default_factory=Episodes)
