// SPDX-License-Identifier: Apache-2.0
#pragma once

/// @file
/// Sets of navigation episodes: draw, load, save.

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "earshot/config.h"
#include "earshot/vec3.h"

namespace earshot::api {

/// One navigation episode: walk from the start to the sounding goal.  Positions are foot points.
struct Episode {
  std::string id, scene, sound;
  Vec3 start, goal;
  double start_heading_deg = 0;
  double distance_m = 0;   ///< on foot, start to goal
  int oracle_actions = 0;  ///< of the oracle, stop included
};

/// Which episodes to draw.
struct EpisodeOptions {
  std::vector<std::string> scenes = {};  ///< SCENEs; house:10..14 stands for five houses
  std::vector<std::string> sounds = {
      "synth:telephone"};  ///< one is drawn per episode; synth:bird:0..3 stands for four, a folder for its files
  int episodes_per_scene = 50;
  int goals_per_scene = 0;  ///< places of the source that the episodes of a scene share; 0: each episode has its own
  std::uint64_t seed = 0;
  Settings settings = {};  ///< further keys of a data section: filter.min_geodesic_m, scenario.*, agents.*
  Settings task = {};      ///< keys of env.task, which decide the oracle's actions: forward_m, turn_deg, max_steps
};

/// Episodes in a fixed order.  Immutable; copies share them.
class EpisodeSet {
 public:
  /// Reads an AudioNav JSON file, plain or gzip.
  /// @throws InputError for a missing or damaged file.
  static EpisodeSet load(const std::filesystem::path& path);
  /// Draws episodes; equal options give equal episodes.
  /// @throws InputError for an unknown key or scene, or if the filter leaves no episode.
  static EpisodeSet generate(const EpisodeOptions& options);

  /// Writes JSON, compressed if the name ends in .gz, whole or not at all.
  void save(const std::filesystem::path& path) const;
  [[nodiscard]] std::size_t size() const;
  [[nodiscard]] std::uint64_t hash() const;  ///< of the contents
  /// @throws std::out_of_range for an index that does not exist.
  [[nodiscard]] Episode operator[](std::size_t index) const;

  struct Model;
  [[nodiscard]] const std::shared_ptr<const Model>& model() const { return model_; }  ///< for the library

 private:
  explicit EpisodeSet(std::shared_ptr<const Model> model) : model_(std::move(model)) {}
  std::shared_ptr<const Model> model_;
};

}  // namespace earshot::api
