// SPDX-License-Identifier: Apache-2.0
#include "bench/soak/scenes.h"

#include <fmt/format.h>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "sim/scene/generators/house_generator.h"

namespace earshot {
namespace {

constexpr std::array<const char*, 8> kWallMaterials{"gypsum_board", "plaster_on_brick", "brick_painted", "concrete_smooth",
                                                    "marble",       "office_partition", "melamine_foam", "acoustic_plaster"};

/// The choices of one scene, in the order in which they are drawn.
class Choices {
 public:
  Choices(std::uint64_t seed, int index) : random_(seed, Purpose::bench, static_cast<std::uint32_t>(index)) {}
  int count(int low, int high) { return low + static_cast<int>(random_.below(static_cast<std::uint32_t>(high - low + 1), next_++)); }
  double between(double low, double high) { return low + (high - low) * static_cast<double>(random_.uniform(next_++)); }

 private:
  RandomStream random_;
  std::uint32_t next_ = 0;
};

std::string house_text(Choices& choices, int rooms, const std::string& suffix = "") {
  return fmt::format("{},rooms={},area_m2={:.0f}{}", choices.count(0, 99'999'999), rooms, rooms * choices.between(12, 20), suffix);
}

SoakScene house(SoakKind kind, const std::string& text) { return {.spec = "house:" + text, .kind = kind, .house = text}; }

std::string box_text(Choices& choices, double low_m, double high_m, const std::string& material) {
  return fmt::format("shoebox:{:.2f}x{:.2f}x{:.2f}@{}", choices.between(low_m, high_m), choices.between(2.2, 4),
                     choices.between(low_m, high_m), material);
}

SoakScene ordinary(Choices& choices) {
  if (choices.count(1, 10) <= 7) return house(SoakKind::house, house_text(choices, choices.count(2, 8)));
  const bool named = choices.count(0, 1) == 1;
  const std::string material =
      named ? kWallMaterials[static_cast<std::size_t>(choices.count(0, 7))] : fmt::format("{:.3f}", choices.between(0.02, 0.6));
  return {.spec = box_text(choices, 3, 9, material), .kind = SoakKind::shoebox};
}

/// A house in files: folder/name.obj (open: without its ceiling) and folder/name.yaml.
SoakScene house_in_files(SoakKind kind, const std::filesystem::path& folder, const std::string& name, const std::string& text) {
  const double offset_x_m = kind == SoakKind::far_away ? 1e5 : 0.0;
  const TriangleMesh mesh = generate_house(parse_house(text));
  std::string obj;
  for (const glm::vec3& v : mesh.vertices) obj += fmt::format("v {:.4f} {:.4f} {:.4f}\n", static_cast<double>(v.x) + offset_x_m, v.y, v.z);
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (kind == SoakKind::open && mesh.object_names[mesh.triangle_object[i]].starts_with("ceiling")) continue;
    const glm::uvec3 t = mesh.triangles[i] + 1u;
    obj += fmt::format("f {} {} {}\n", t.x, t.y, t.z);
  }
  const std::filesystem::path yaml = folder / (name + ".yaml");
  write_file_atomically(folder / (name + ".obj"), obj);
  write_file_atomically(yaml, fmt::format("mesh: {}.obj\ndefault_material: plaster_on_brick\n", name));
  return {.spec = yaml.string(), .kind = kind, .house = text};
}

/// turn: number of earlier scenes of this kind.
SoakScene hard(SoakKind kind, int turn, int index, Choices& choices, const std::filesystem::path& folder) {
  const bool is_even = turn % 2 == 0;
  const auto box = [&](std::string spec) { return SoakScene{.spec = std::move(spec), .kind = kind}; };
  switch (kind) {
    case SoakKind::tiny:
      return box(fmt::format("shoebox:{:.2f}x{:.2f}x{:.2f}@0.1", choices.between(1.05, 1.4), choices.between(1.7, 2.2),
                             choices.between(1.05, 1.4)));
    case SoakKind::absorbing:
      return box(box_text(choices, 3, 7, is_even ? "0.99" : "1"));
    case SoakKind::rigid:
      return box(box_text(choices, 3, 7, is_even ? "0.001" : "0"));
    case SoakKind::flutter:
      return box(box_text(choices, 3, 7, "0.9,0.9,0.9,0.9,0.01,0.01"));
    case SoakKind::corridor:
      return box(fmt::format("shoebox:40x2.4x{:.2f}@concrete_painted", choices.between(1, 1.6)));
    case SoakKind::hall:
      return box(fmt::format("shoebox:40x{:.1f}x30@0.05", choices.between(8, 16)));
    case SoakKind::many_rooms:
      return house(kind, house_text(choices, 16));
    case SoakKind::detailed:
      return house(kind, house_text(choices, choices.count(2, 3), ",detail_m=0.25"));
    default:
      return house_in_files(kind, folder, fmt::format("soak_{}", index), house_text(choices, choices.count(2, 4)));
  }
}

}  // namespace

std::vector<SoakScene> make_soak_scenes(std::uint64_t seed, int count, int hard_every, const std::filesystem::path& folder) {
  require(count >= 1 && count <= 1'000'000, "--scenes", count, "must be in [1, 1000000]");
  require(hard_every >= 0, "--hard-every", hard_every, "must not be negative; 0: no hard scenes");
  constexpr int kFirstHard = static_cast<int>(SoakKind::tiny), kHardKinds = static_cast<int>(kNumSoakKinds) - kFirstHard;
  std::vector<SoakScene> scenes;
  for (int index = 0, hard_count = 0; index < count; ++index) {
    Choices choices(seed, index);
    if (hard_every > 0 && index % hard_every == hard_every - 1) {
      const auto kind = static_cast<SoakKind>(kFirstHard + hard_count % kHardKinds);
      scenes.push_back(hard(kind, hard_count / kHardKinds, index, choices, folder));
      ++hard_count;
    } else {
      scenes.push_back(ordinary(choices));
    }
  }
  return scenes;
}

}  // namespace earshot
