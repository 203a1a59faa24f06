// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "datasets/corpus_parts.h"
#include "datasets/grid/grid_files.h"
#include "datasets/grid/grid_source.h"
#include "sim/audio/head/listener_layout.h"
#include "sim/scene/scene.h"

namespace earshot {

struct GridCorpusConfig {
  GridNames names;
  double spacing_m = 1, ear_height_m = 1.5;
  std::string channels = "binaural";
  std::string head;  ///< what corpus.json says of the head, so that a run with another one does not complete the folder
  GridFormat format = GridFormat::wav;
  std::optional<std::pair<int, int>> pictures_px;  ///< width and height
  SceneOverrides overrides = {};                   ///< those the scene was loaded with
};

/// binaural_rirs or ambisonic_rirs, the folders of the published form.  Throws InputError for other channels, and for harmonics in the axes
/// of a listener.
std::string grid_folder(const std::string& channels);

struct GridReport {
  std::uint64_t responses = 0, all_responses = 0;  ///< written by this run; of the grid
  std::size_t folders_missing = 0;                 ///< sources of other shards
};

/// Writes the responses between all points of a grid, or completes them (docs/howto/datasets_grid.md).  Every byte is a function of
/// (config, scene, acoustics, program), not of threads, shards or how often the run was killed.
///
///   OUT/metadata/DATASET/SCENE/points.txt, edges.txt              grid_points.h
///   OUT/metadata/DATASET/SCENE/scene.json                         hash of the scene, spacing, height of the ears
///   OUT/binaural_rirs/DATASET/SCENE/AZIMUTH/RECEIVER_SOURCE.wav   32-bit float; ambisonic_rirs/DATASET/SCENE/RECEIVER_SOURCE.wav
///   OUT/binaural_rirs/DATASET/SCENE/responses.zarr/               in place of those with GridFormat::zarr; .zarray last.  Axes:
///                                                                 source, receiver, azimuth (not for ambisonics), channel, sample
///   OUT/binaural_rirs/DATASET/SCENE/corpus.json, manifest.jsonl   as in rir_corpus.h; one line per pair; parts/ holds those of sources
///   OUT/scene_observations/DATASET/SCENE/POINT.rgb.npy, POINT.depth.npy   grid_pictures.h; pictures.json: their size and scene
///
/// Throws InputError: another grid, scene or corpus, or other pictures in the folder, or less free space than the files take; RunError:
/// disk full.
GridReport write_grid_corpus(const GridCorpusConfig& config, const GridRendering& rendering, const CorpusRun& run);

}  // namespace earshot
