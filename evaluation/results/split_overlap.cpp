// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/split_overlap.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <glm/common.hpp>
#include <limits>
#include <map>
#include <set>
#include <string_view>
#include <vector>

#include "envs/hearing/sound_library.h"
#include "evaluation/results/episode_walk.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

constexpr float kCellM = 0.05f;
constexpr float kSampleRateHz = 16000.f;

/// Rising, each once; 21 bits an axis, which are 100 km.
constexpr std::uint64_t kMaxCell = (std::uint64_t{1} << 21) - 1;
using Cells = std::vector<std::uint64_t>;

Cells cells_of(const TriangleMesh& mesh) {
  glm::vec3 low(std::numeric_limits<float>::max());
  for (const glm::vec3 vertex : mesh.vertices) low = glm::min(low, vertex);
  const auto bits = [](float cell) { return std::min(static_cast<std::uint64_t>(cell), kMaxCell); };
  Cells cells;
  cells.reserve(mesh.vertices.size());
  for (const glm::vec3 vertex : mesh.vertices) {
    const glm::vec3 cell = glm::round((vertex - low) / kCellM);
    cells.push_back(bits(cell.x) << 42 | bits(cell.y) << 21 | bits(cell.z));
  }
  std::ranges::sort(cells);
  cells.erase(std::unique(cells.begin(), cells.end()), cells.end());
  return cells;
}

double overlap(const Cells& a, const Cells& b) {
  if (a.empty() || b.empty()) return 0;
  std::size_t common = 0;
  for (std::size_t i = 0, j = 0; i < a.size() && j < b.size();) {
    common += a[i] == b[j] ? 1 : 0;
    const bool first_precedes = a[i] < b[j], second_precedes = b[j] < a[i];
    i += second_precedes ? 0 : 1;
    j += first_precedes ? 0 : 1;
  }
  return static_cast<double>(common) / static_cast<double>(std::min(a.size(), b.size()));
}

/// "house:3" of "house:3,rooms=2"; a file's name as it is.
std::string identity_of(const std::string& scene) {
  const bool generated = scene.starts_with("house:") || scene.starts_with("floor:");
  return generated ? scene.substr(0, scene.find(',')) : scene;
}

/// "synth:bird" is "synth:bird:0".
std::string sound_identity(const std::string& sound) {
  if (!sound.starts_with("synth:")) return sound;
  return std::count(sound.begin(), sound.end(), ':') == 1 ? sound + ":0" : sound;
}

/// Hash of the samples at the scale of their largest, in steps of 2^-8: a copy at another level has the same.
std::uint64_t content_of(const std::string& sound, const std::string& sound_root) {
  const SoundClip clip = open_sound(resolve_sound(sound, sound_root), kSampleRateHz);
  float most = 0;
  for (const float sample : clip.samples) most = std::max(most, std::abs(sample));
  std::string text;
  for (const float sample : clip.samples) text += static_cast<char>(most > 0 ? std::lround(127.f * sample / most) : 0);
  return hash64(text);
}

/// Of the two lists, the first pair that `identity` maps to the same.
template <class Identity>
std::optional<SplitOverlap> find_overlap(std::span<const std::string> trained, std::span<const std::string> tested, const char* why,
                                         const Identity& identity) {
  std::map<decltype(identity(trained[0])), std::string> known;
  for (const std::string& name : trained) known.emplace(identity(name), name);
  for (const std::string& name : tested)
    if (const auto found = known.find(identity(name)); found != known.end()) return SplitOverlap{name, found->second, why};
  return std::nullopt;
}

}  // namespace

double geometry_overlap(const TriangleMesh& a, const TriangleMesh& b) { return overlap(cells_of(a), cells_of(b)); }

std::vector<std::string> shared_scenes(std::span<const std::string> trained, std::span<const std::string> tested) {
  std::set<std::string> known;
  for (const std::string& scene : trained) known.insert(identity_of(scene));
  std::vector<std::string> shared;
  for (const std::string& scene : tested)
    if (known.contains(identity_of(scene))) shared.push_back(scene);
  return shared;
}

std::optional<SplitOverlap> find_scene_overlap(std::span<const std::string> trained, std::span<const std::string> tested,
                                               const std::string& scene_root) {
  if (auto found = find_overlap(trained, tested, "the same as", identity_of)) return found;
  const auto cells = [&](const std::string& scene) { return cells_of(load_scene_under(scene, scene_root)->mesh()); };
  std::vector<Cells> known;
  for (const std::string& scene : trained) known.push_back(cells(scene));
  for (const std::string& scene : tested) {
    const Cells cells_of_scene = cells(scene);
    for (std::size_t i = 0; i < known.size(); ++i)
      if (overlap(known[i], cells_of_scene) >= kNearDuplicate) return SplitOverlap{scene, trained[i], "a near-duplicate of"};
  }
  return std::nullopt;
}

std::optional<SplitOverlap> find_sound_overlap(std::span<const std::string> trained, std::span<const std::string> tested,
                                               const std::string& sound_root) {
  if (auto found = find_overlap(trained, tested, "the same as", sound_identity)) return found;
  return find_overlap(trained, tested, "another copy of", [&](const std::string& sound) { return content_of(sound, sound_root); });
}

}  // namespace earshot
