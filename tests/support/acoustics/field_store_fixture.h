// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "sim/acoustics/source_field/source_field_store.h"
#include "sim/scene/scene.h"

namespace earshot {

/// A field of a few photons in a fraction of a second.
inline AcousticConfig quick_config() {
  AcousticConfig config;
  config.early_candidate_rays = 100;
  config.rir_length_s = 0.2f;
  config.field_photons = 1024;
  config.field_error = 1.f;
  return config;
}

inline AcousticScene load_room(const AcousticConfig& config, const std::string& id = "shoebox:6x3x4@0.3") {
  return AcousticScene(std::make_shared<const Scene>(load_scene(id)), config);
}

/// One source in one room, a folder for stores and the warnings they gave.
class FieldStore : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() /
              ("earshot_fields_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()) + std::to_string(::getpid()));
    std::filesystem::remove_all(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  FieldStoreConfig config() {
    return {.folder = folder_, .max_bytes = 1 << 30, .max_memory_bytes = 0, .warn = [this](const std::string& message) {
              warnings_.push_back(message);
            }};
  }
  [[nodiscard]] std::vector<std::filesystem::path> files() const {
    std::vector<std::filesystem::path> found;
    for (const auto& entry : std::filesystem::directory_iterator(folder_)) found.push_back(entry.path());
    return found;
  }

  const AcousticScene room_ = load_room(quick_config());
  const EarlyCandidates source_{room_, glm::vec3{1.5f, 1.4f, 1.1f}};
  std::filesystem::path folder_;
  std::vector<std::string> warnings_;
};

}  // namespace earshot
