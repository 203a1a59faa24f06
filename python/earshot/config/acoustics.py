# SPDX-License-Identifier: Apache-2.0
"""Simulation of responses.  Made by scripts/make_config_classes.py from `earshot config --json`."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Literal

from .._section import Section

if TYPE_CHECKING:
    AutoOffOn = Literal["auto", "off", "on"]
else:  # OmegaConf 2.3 knows no Literal and no unions of lists
    AutoOffOn = str


@dataclasses.dataclass(kw_only=True, slots=True)
class Acoustics(Section):
    """Simulation of responses: a preset, and keys over it."""

    #: Preset that the other keys start from: fast (training), balanced or high (reference). Empty: fast. Range: fast, balanced or
    #: high.
    preset: str = ""
    #: Direct sound. auto: the effect plan decides. Without a preset: auto.
    direct: AutoOffOn | None = None
    #: Early specular reflections, from image paths. auto: the effect plan decides. Without a preset: auto.
    early: AutoOffOn | None = None
    #: Late sound, from traced rays or a source field. auto: the effect plan decides. Without a preset: auto.
    late: AutoOffOn | None = None
    #: Diffraction around edges. auto: the effect plan decides. Without a preset: auto.
    diffraction: AutoOffOn | None = None
    #: Transmission through walls. auto: the effect plan decides. Without a preset: auto.
    transmission: AutoOffOn | None = None
    #: Rise of late sound where a source or a listener is near walls (Waterhouse 1955). auto: in bands that it changes by more than
    #: 0.1 dB. Without a preset: auto.
    wall_power: AutoOffOn | None = None
    #: Absorption in air (ISO 9613-1). auto: the effect plan decides. Without a preset: auto.
    air_absorption: AutoOffOn | None = None
    #: Points of a source with a radius whose sight from the listener decides its direct sound. 0 or 1: its centre alone. No effect
    #: on point sources. Range: 0 to 4,096. Without a preset: 64.
    direct_rays: int | None = None
    #: Largest number of specular reflections of an image path. Range: 0 to 4. Without a preset: 2.
    early_order: int | None = None
    #: Rays traced once per source to find the sequences of planes of image paths. Range: 0 to 10,000,000. Without a preset: 2000.
    early_candidate_rays: int | None = None
    #: Largest number of edges in a diffraction path. Range: 1 to 10. Without a preset: 3.
    diffraction_order: int | None = None
    #: Length below which edges are left out. Range: above 0 and at most 100. Without a preset: 0.25.
    diffraction_edge_m: float | None = None
    #: Number of diffraction paths that are kept, the strongest first. Range: 1 to 10,000. Without a preset: 64.
    diffraction_paths: int | None = None
    #: Reflections in large planes on either side of the edges of a diffraction path. Range: 0 to 1. Without a preset: 0.
    diffraction_reflections: int | None = None
    #: Largest number of walls that sound passes in a straight line. Range: 1 to 50. Without a preset: 8.
    transmission_walls: int | None = None
    #: Rays traced from the listener for each response. More rays: less noise, and proportionally more time. Range: 0 to
    #: 2,147,483,647. Without a preset: 64.
    rays: int | None = None
    #: Rays traced from the source for bidirectional path tracing. 0: rays from the listener only. Range: 0 to 1,048,576. Without a
    #: preset: 0.
    source_rays: int | None = None
    #: Reflections of a source ray that are kept; only with source_rays above 0. Range: 1 to 60. Without a preset: 10.
    source_bounces: int | None = None
    #: Exponent n of the lobe cos^n of specular reflections, at least 1. 0: reflections as from a mirror. from_scattering: one lobe
    #: for all reflections, n = 3 / s - 3 of the scattering coefficient s of each material and band. Range: 0 to 1,000, or
    #: from_scattering. Without a preset: 0.
    specular_exponent: float | str | None = None
    #: Largest number of reflections of a ray, a safety bound: time and Russian roulette end rays earlier. Range: 0 to
    #: 2,147,483,647. Without a preset: 1000.
    max_bounces: int | None = None
    #: Width of a time bin of the energy response. Range: 0.00001 to 0.1. Without a preset: 0.004.
    time_bin_s: float | None = None
    #: Order of the spherical harmonics of the arrival directions of late sound. Range: 0 to 5. Without a preset: 1.
    sh_order: int | None = None
    #: Length of a response. auto: as long as the decay of the scene needs, at most 4 s. Range: above 0 and at most 60, or auto.
    #: Without a preset: 0.5.
    rir_length_s: float | str | None = None
    #: Radius of the sphere in which specular paths meet the source, without diffuse_last_segment. auto: a twelfth of the mean free
    #: path, within 0.25 to 2 m. Range: above 0 and at most 100, or auto. Without a preset: auto.
    source_radius_m: float | str | None = None
    #: Scattering coefficient for every material. Negative: each material has its own. Range: at most 1. Without a preset: -1.
    scattering: float | None = None
    #: Late sound from a source field: photons are traced once per source, and each pose gathers from them. auto: where a source is
    #: heard from many poses and the field costs less than rays. Without a preset: auto.
    field: AutoOffOn | None = None
    #: Largest number of photons of a source field. Range: 512 to 16,777,216. Without a preset: 65536.
    field_photons: int | None = None
    #: Relative standard error of T20 below which no more photons are added to a source field. Range: above 0 and at most 1. Without
    #: a preset: 0.037.
    field_error: float | None = None
    #: Edge of the cells of a source field, approximately. Range: 0.05 to 10. Without a preset: 1.
    field_cell_m: float | None = None
    #: Blends traced late sound along a trajectory, which reduces noise. auto: where the source moves. No effect on a single
    #: response. Without a preset: auto.
    temporal_reuse: AutoOffOn | None = None
    #: Binaural: late sound up to this time after its onset is rendered through the head as a first-order sound field; what follows
    #: has the right level and interaural correlation only. Range: 0 to 60. Without a preset: 0.16.
    late_decode_s: float | None = None
    #: Number of the strongest paths whose delays move smoothly from pose to pose along a trajectory. 0: none. No effect on a single
    #: response. Range: 0 to 64. Without a preset: 3.
    glide_paths: int | None = None
    #: Number of logarithmically spaced frequency bands. 0: octaves from 125 Hz to 16 kHz, up to half the sample rate. Range: 1 to
    #: 32, or 0. Without a preset: 0.
    bands: int | None = None
    #: Adds an octave at 63 Hz; only with bands 0. Without it sound below 89 Hz is that of 125 Hz. Without a preset: false.
    low_octave: bool | None = None
    #: Sample rate of responses and sounds. Range: 8,000 to 96,000. Without a preset: 16000.
    sample_rate_hz: float | None = None
    #: Seed of rays and noise carriers; the same seed gives the same bits. Range: 0 to 2^64 - 1. Without a preset: 0.
    seed: int | None = None
    #: Threads of one response. 0: all cores. Any number gives the same bits. Range: 0 to 4,096. Without a preset: 1.
    threads: int | None = None
    #: Treats the last segment of late paths as diffuse: far less noise for a small bias. false: unbiased. Without a preset: true.
    diffuse_last_segment: bool | None = None


@dataclasses.dataclass(kw_only=True, slots=True)
class CorpusAcoustics(Section):
    """Simulation of responses: a preset, and keys over it."""

    #: Preset that the other keys start from: fast (training), balanced or high (reference). Empty: fast. Range: fast, balanced or
    #: high.
    preset: str = ""
    #: Direct sound. auto: the effect plan decides. Without a preset: auto.
    direct: AutoOffOn | None = None
    #: Early specular reflections, from image paths. auto: the effect plan decides. Without a preset: auto.
    early: AutoOffOn | None = None
    #: Late sound, from traced rays or a source field. auto: the effect plan decides. Without a preset: auto.
    late: AutoOffOn | None = None
    #: Diffraction around edges. auto: the effect plan decides. Without a preset: auto.
    diffraction: AutoOffOn | None = None
    #: Transmission through walls. auto: the effect plan decides. Without a preset: auto.
    transmission: AutoOffOn | None = None
    #: Rise of late sound where a source or a listener is near walls (Waterhouse 1955). auto: in bands that it changes by more than
    #: 0.1 dB. Without a preset: auto.
    wall_power: AutoOffOn | None = None
    #: Absorption in air (ISO 9613-1). auto: the effect plan decides. Without a preset: auto.
    air_absorption: AutoOffOn | None = None
    #: Points of a source with a radius whose sight from the listener decides its direct sound. 0 or 1: its centre alone. No effect
    #: on point sources. Range: 0 to 4,096. Without a preset: 64.
    direct_rays: int | None = None
    #: Largest number of specular reflections of an image path. Range: 0 to 4. Without a preset: 2.
    early_order: int | None = None
    #: Rays traced once per source to find the sequences of planes of image paths. Range: 0 to 10,000,000. Without a preset: 2000.
    early_candidate_rays: int | None = None
    #: Largest number of edges in a diffraction path. Range: 1 to 10. Without a preset: 3.
    diffraction_order: int | None = None
    #: Length below which edges are left out. Range: above 0 and at most 100. Without a preset: 0.25.
    diffraction_edge_m: float | None = None
    #: Number of diffraction paths that are kept, the strongest first. Range: 1 to 10,000. Without a preset: 64.
    diffraction_paths: int | None = None
    #: Reflections in large planes on either side of the edges of a diffraction path. Range: 0 to 1. Without a preset: 0.
    diffraction_reflections: int | None = None
    #: Largest number of walls that sound passes in a straight line. Range: 1 to 50. Without a preset: 8.
    transmission_walls: int | None = None
    #: Rays traced from the listener for each response. More rays: less noise, and proportionally more time. Range: 0 to
    #: 2,147,483,647. Without a preset: 64.
    rays: int | None = None
    #: Rays traced from the source for bidirectional path tracing. 0: rays from the listener only. Range: 0 to 1,048,576. Without a
    #: preset: 0.
    source_rays: int | None = None
    #: Reflections of a source ray that are kept; only with source_rays above 0. Range: 1 to 60. Without a preset: 10.
    source_bounces: int | None = None
    #: Exponent n of the lobe cos^n of specular reflections, at least 1. 0: reflections as from a mirror. from_scattering: one lobe
    #: for all reflections, n = 3 / s - 3 of the scattering coefficient s of each material and band. Range: 0 to 1,000, or
    #: from_scattering. Without a preset: 0.
    specular_exponent: float | str | None = None
    #: Largest number of reflections of a ray, a safety bound: time and Russian roulette end rays earlier. Range: 0 to
    #: 2,147,483,647. Without a preset: 1000.
    max_bounces: int | None = None
    #: Width of a time bin of the energy response. Range: 0.00001 to 0.1. Without a preset: 0.004.
    time_bin_s: float | None = None
    #: Order of the spherical harmonics of the arrival directions of late sound. Range: 0 to 5. Without a preset: 1.
    sh_order: int | None = None
    #: Length of a response. auto: as long as the decay of the scene needs, at most 4 s. Range: above 0 and at most 60, or auto.
    #: Without a preset: 1.
    rir_length_s: float | str | None = None
    #: Radius of the sphere in which specular paths meet the source, without diffuse_last_segment. auto: a twelfth of the mean free
    #: path, within 0.25 to 2 m. Range: above 0 and at most 100, or auto. Without a preset: auto.
    source_radius_m: float | str | None = None
    #: Scattering coefficient for every material. Negative: each material has its own. Range: at most 1. Without a preset: -1.
    scattering: float | None = None
    #: Late sound from a source field: photons are traced once per source, and each pose gathers from them. auto: where a source is
    #: heard from many poses and the field costs less than rays. Without a preset: auto.
    field: AutoOffOn | None = None
    #: Largest number of photons of a source field. Range: 512 to 16,777,216. Without a preset: 65536.
    field_photons: int | None = None
    #: Relative standard error of T20 below which no more photons are added to a source field. Range: above 0 and at most 1. Without
    #: a preset: 0.037.
    field_error: float | None = None
    #: Edge of the cells of a source field, approximately. Range: 0.05 to 10. Without a preset: 1.
    field_cell_m: float | None = None
    #: Binaural: late sound up to this time after its onset is rendered through the head as a first-order sound field; what follows
    #: has the right level and interaural correlation only. Range: 0 to 60. Without a preset: 0.16.
    late_decode_s: float | None = None
    #: Number of logarithmically spaced frequency bands. 0: octaves from 125 Hz to 16 kHz, up to half the sample rate. Range: 1 to
    #: 32, or 0. Without a preset: 0.
    bands: int | None = None
    #: Adds an octave at 63 Hz; only with bands 0. Without it sound below 89 Hz is that of 125 Hz. Without a preset: false.
    low_octave: bool | None = None
    #: Sample rate of responses and sounds. Range: 8,000 to 96,000. Without a preset: 16000.
    sample_rate_hz: float | None = None
    #: Seed of rays and noise carriers; the same seed gives the same bits. Range: 0 to 2^64 - 1. Without a preset: 0.
    seed: int | None = None
    #: Treats the last segment of late paths as diffuse: far less noise for a small bias. false: unbiased. Without a preset: true.
    diffuse_last_segment: bool | None = None
