// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <span>
#include <string>
#include <vector>

#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/random.h"
#include "tests/support/envs/env_fixture.h"

namespace earshot {

/// A folder of its own that goes with the test.
class TestFolder {
 public:
  explicit TestFolder(const std::string& name)
      : path_(std::filesystem::temp_directory_path() / ("earshot_" + name + "_" + std::to_string(::getpid()))) {
    std::filesystem::remove_all(path_);
    std::filesystem::create_directories(path_);
  }
  ~TestFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TestFolder(const TestFolder&) = delete;
  TestFolder& operator=(const TestFolder&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  [[nodiscard]] std::vector<std::filesystem::path> files() const {
    std::vector<std::filesystem::path> all;
    for (const auto& entry : std::filesystem::directory_iterator(path_)) all.push_back(entry.path());
    return all;
  }

 private:
  std::filesystem::path path_;
};

inline void write_text(const std::filesystem::path& path, const std::string& text) { std::ofstream(path, std::ios::binary) << text; }

/// The inside of a box from the origin to (x, y, z), as an OBJ file.
inline std::string room_obj(float x, float y, float z) {
  std::string text;
  for (int corner = 0; corner < 8; ++corner)
    text += "v " + std::to_string(corner & 1 ? x : 0.f) + " " + std::to_string(corner & 2 ? y : 0.f) + " " +
            std::to_string(corner & 4 ? z : 0.f) + "\n";
  // Faces of the corners' bits, turned inward.
  return text + "f 1 5 6 2\nf 3 4 8 7\nf 1 2 4 3\nf 5 7 8 6\nf 1 3 7 5\nf 2 6 8 4\n";
}

inline bool is_finite(std::span<const float> values) {
  for (const float value : values)
    if (!std::isfinite(value)) return false;
  return true;
}

/// Resident memory of this process in MiB.
inline double resident_mib() {
  std::ifstream statm("/proc/self/statm");
  double pages = 0, resident = 0;
  statm >> pages >> resident;
  return resident * static_cast<double>(::sysconf(_SC_PAGESIZE)) / 1048576.0;
}

/// Everything a policy or a learner may read.
inline bool buffers_are_finite(const BatchedEnv& env) {
  for (const auto rows : {float_rows(env, "depth"), float_rows(env, "spectrogram"), float_rows(env, "waveform"), float_rows(env, "heard"),
                          float_rows(env, "pointgoal"), env.rewards(), final_float_rows(env, "depth"), final_float_rows(env, "spectrogram"),
                          final_float_rows(env, "pointgoal")})
    if (!is_finite(rows)) return false;
  for (const FinishedEpisode& end : env.finished())
    for (const double value :
         {end.metrics.success, end.metrics.spl, end.metrics.soft_spl, end.metrics.sna, end.metrics.dtg_m, end.metrics.reward})
      if (!std::isfinite(value)) return false;
  return true;
}

template <class T>
std::vector<T> row_of(std::span<const T> rows, int num_envs, int env) {
  const std::size_t size = rows.size() / static_cast<std::size_t>(num_envs);
  const auto row = rows.subspan(static_cast<std::size_t>(env) * size, size);
  return {row.begin(), row.end()};
}

/// What env `env` of a batch shows.
inline std::vector<float> shown_by(const BatchedEnv& env, int row) {
  std::vector<float> all;
  for (const auto rows : {float_rows(env, "depth"), float_rows(env, "spectrogram"), float_rows(env, "waveform"), float_rows(env, "heard"),
                          float_rows(env, "pointgoal")}) {
    const auto part = row_of(rows, env.num_envs(), row);
    all.insert(all.end(), part.begin(), part.end());
  }
  return all;
}

}  // namespace earshot
