// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "earshot/scene.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/base/kept_results.h"
#include "sim/scene/appearance.h"
#include "sim/scene/scene.h"

namespace earshot::api {

/// A scene with acoustic settings.  Parts that depend on the channels of a listener (order of harmonics, synthesis tables) are made when
/// they are first needed, and kept.  Safe from any thread.
struct Scene::Model {
  Model(const std::string& spec, const SceneOptions& options);

  [[nodiscard]] const earshot::Scene& scene() const { return *scene_; }
  [[nodiscard]] const AcousticConfig& config() const { return config_; }
  [[nodiscard]] std::vector<std::string> warnings() const;
  /// Adds the lines that are not there.
  void add_warnings(const std::vector<std::string>& lines);

  /// Order of the harmonics that these channels need of the late field: as `earshot rir` chooses it.
  [[nodiscard]] int harmonics_of(const ListenerLayout& layout) const;
  std::shared_ptr<const AcousticScene> acoustics(int sh_order);
  /// With the order of harmonics of the settings.
  std::shared_ptr<const AcousticScene> acoustics() { return acoustics(config_.sh_order); }
  /// channels: as ListenerLayout::named.  hrtf: SOFA file; empty: a rigid sphere.
  std::shared_ptr<const SynthesisTables> tables(const std::string& channels, const std::string& hrtf);
  /// Colours and categories, read at the first call.
  std::shared_ptr<const Appearance> appearance();

 private:
  struct TablesOfFiles {
    std::string state;  ///< state_of_files(), before they were read
    std::shared_ptr<const SynthesisTables> tables;
  };

  std::shared_ptr<const earshot::Scene> scene_;
  AcousticConfig config_;
  SceneOverrides overrides_;
  mutable std::mutex mutex_;  ///< guards the warnings
  std::vector<std::string> warnings_;
  KeptResults<int, AcousticScene> acoustics_;                               ///< by order of harmonics
  KeptResults<std::pair<std::string, std::string>, TablesOfFiles> tables_;  ///< by channels and head
  KeptResults<int, Appearance> appearance_;                                 ///< by 0
};

}  // namespace earshot::api
