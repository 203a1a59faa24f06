// SPDX-License-Identifier: Apache-2.0
// How much responses of one processor differ by the instruction set that Embree uses (EARSHOT_ISA), through the program that a user starts.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "sim/base/random.h"
#include "sim/nav/navmesh.h"
#include "sim/rays/embree_options.h"
#include "sim/scene/scene.h"
#include "tests/support/files/test_files.h"
#include "tests/support/files/test_paths.h"

namespace earshot {
namespace {

constexpr int kListeners = 4;
/// Crossings are computed in double from the corners of the triangle (sim/rays/hit_surface.h), the same ones with every set; which triangle
/// is hit is the set's own choice.
constexpr double kTolerance = 1e-4;
/// Of AVX-512, which is in use only where it is asked for: of the late field's stated standard error.  A late ray that takes another
/// surface at an edge goes another way from there, with 1 / rays of the energy and more of what reaches a far room.
constexpr double kOfStandardError = 0.05;

int run(const std::string& command) {
  const int status = std::system(command.c_str());
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

/// "X,Y,Z" of points that are drawn on the floor of a scene, 1.5 m above it.
std::vector<std::string> draw_places(const std::string& name, int count) {
  const Scene scene = load_scene(name);
  const Navmesh navmesh(scene.mesh(), NavmeshConfig{});
  std::vector<std::string> places;
  for (int i = 0; i < count; ++i) {
    const RandomStream random(23, Purpose::test, static_cast<std::uint32_t>(i));
    const glm::dvec3 place = scene.to_world(navmesh.random_point(random, 0) + glm::vec3(0, 1.5f, 0));
    places.push_back(fmt::format("{:.4f},{:.4f},{:.4f}", place.x, place.y, place.z));
  }
  return places;
}

/// Of every listener: the energy of each band, then of all, from the strengths of the energy response, and what each may differ by with
/// AVX-512.
struct Energies {
  std::vector<double> energy, tolerance_of_wider;
};

std::vector<Energies> energies(const std::string& isa, const std::string& scene, const std::string& preset,
                               const std::vector<std::string>& places, const std::string& folder) {
  std::string command =
      fmt::format("EARSHOT_ISA={} {} rir '{}' --preset {} --channels mono --source {} --out {}/rir.wav --metrics {}/rir.json", isa,
                  earshot_program().string(), scene, preset, places[0], folder, folder);
  for (std::size_t i = 1; i < places.size(); ++i) command += " --listener " + places[i];
  EXPECT_EQ(run(command + " >" + folder + "/log 2>&1"), 0) << command;
  std::ifstream file(folder + "/rir.json");
  const nlohmann::json document = nlohmann::json::parse(file, nullptr, false);
  std::vector<Energies> result;
  if (!document.contains("pairs")) {
    ADD_FAILURE() << "no pairs in what " << command << " wrote";
    return result;
  }
  for (const nlohmann::json& pair : document["pairs"]) {
    const nlohmann::json& strengths_db = pair["energy"]["g_db"];
    const nlohmann::json errors_db = pair["standard_error"].value("g_db", nlohmann::json::array());
    Energies row_energies;
    double sum = 0, least = INFINITY;
    for (std::size_t band = 0; band < strengths_db.size(); ++band) {
      row_energies.energy.push_back(strengths_db[band].is_null() ? 0 : std::pow(10, strengths_db[band].get<double>() / 10));
      const double error_db = band < errors_db.size() && errors_db[band].is_number() ? errors_db[band].get<double>() : 0;
      row_energies.tolerance_of_wider.push_back(std::max(kTolerance, std::pow(10, kOfStandardError * error_db / 10) - 1));
      sum += row_energies.energy.back();
      least = std::min(least, row_energies.tolerance_of_wider.back());
    }
    row_energies.energy.push_back(sum);
    row_energies.tolerance_of_wider.push_back(least);
    result.push_back(row_energies);
  }
  return result;
}

TEST(InstructionSets, DifferByATenThousandthOfAnEnergy) {
  const std::string reference = "avx2";
  std::vector<std::string> others;
  for (const RayIsa& isa : ray_isas())
    if (isa.present && isa.name != reference) others.push_back(isa.name);
  if (others.empty()) GTEST_SKIP() << "Embree has one instruction set on this processor";
  const TempFolder folder;
  for (const char* scene : {"shoebox:6x3x5@0.2", "house:7", "house:2,rooms=2,area_m2=30"}) {
    const std::vector<std::string> places = draw_places(scene, 1 + kListeners);
    for (const char* preset : {"fast", "balanced"}) {
      const auto avx2 = energies(reference, scene, preset, places, folder / "");
      ASSERT_EQ(avx2.size(), static_cast<std::size_t>(kListeners));
      for (const std::string& isa : others) {
        const auto other = energies(isa, scene, preset, places, folder / "");
        ASSERT_EQ(other.size(), avx2.size());
        double in_band = 0, in_all = 0;
        for (std::size_t listener = 0; listener < avx2.size(); ++listener) {
          const std::vector<double>&expected = avx2[listener].energy, &found = other[listener].energy;
          ASSERT_EQ(found.size(), expected.size());
          ASSERT_GT(expected.back(), 0) << scene << " listener " << listener;
          for (std::size_t band = 0; band < expected.size(); ++band) {
            if (expected[band] == 0 && found[band] == 0) continue;
            const double difference = std::fabs(found[band] / expected[band] - 1);
            double& greatest = band + 1 == expected.size() ? in_all : in_band;
            greatest = std::max(greatest, difference);
            EXPECT_LE(difference, isa == "avx512" ? avx2[listener].tolerance_of_wider[band] : kTolerance)
                << scene << ' ' << preset << ' ' << isa << " listener " << listener << " band " << band;
          }
        }
        fmt::print("{} {}: {} against {}: {:.1e} in a band, {:.1e} in all\n", scene, preset, isa, reference, in_band, in_all);
      }
    }
  }
}

}  // namespace
}  // namespace earshot
