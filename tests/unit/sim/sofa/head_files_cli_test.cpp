// SPDX-License-Identifier: Apache-2.0
// Heads as their files have them, by `earshot rir --hrtf`: the direct sound of one source in a free field.
#if __has_include(<hdf5.h>)

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/vec3.hpp>
#include <numbers>
#include <tuple>

#include "sim/base/files.h"
#include "tests/support/files/made_head.h"
#include "tests/support/files/test_data.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

using testing::HasSubstr;

double draw(std::uint32_t stream, std::uint32_t index, double low, double high) {
  return low + (high - low) * static_cast<double>(RandomStream(stream, Purpose::test).uniform2(index)[0]);
}
glm::dvec3 draw_direction(std::uint32_t stream, std::uint32_t index) {
  const double height = draw(stream, 2 * index, -1, 1), angle = draw(stream, 2 * index + 1, 0, 2 * std::numbers::pi);
  return {std::sqrt(1 - height * height) * std::cos(angle), std::sqrt(1 - height * height) * std::sin(angle), height};
}

class HeadFiles : public Cli {
 protected:
  void SetUp() override {
    Cli::SetUp();
    if (!std::filesystem::exists(earshot_program())) GTEST_SKIP() << "built without the program";
  }
  /// towards: from the head, axes of SOFA (x front, y left, z up).
  [[nodiscard]] std::string command(const std::string& head, glm::dvec3 towards, double distance_m, const std::string& out) const {
    const glm::dvec3 place = glm::dvec3(20) + distance_m * glm::dvec3(-towards.y, towards.z, -towards.x);
    return "rir shoebox:40x40x40@1 --preset fast --rate " + std::to_string(rate_hz_) +
           " --set early=off --set late=off --set air_absorption=off --listener 20,20,20 "
           "--source " +
           fmt::format("{:.7f},{:.7f},{:.7f}", place.x, place.y, place.z) + " --hrtf " + head + " --out " + file(out);
  }
  /// Left and right.
  struct Ears {
    std::vector<double> left, right;
    [[nodiscard]] double level_db() const {
      const auto energy = [](const std::vector<double>& ear) {
        double sum = 0;
        for (const double value : ear) sum += value * value;
        return sum;
      };
      return 10.0 * std::log10(energy(left) / energy(right));
    }
    /// Lead of the left ear: the place of the largest cross-correlation, between samples by a parabola.
    [[nodiscard]] double lead_samples() const {
      const auto size = static_cast<int>(left.size());
      const auto at = [&](int lag) {
        double sum = 0;
        for (int n = std::max(0, -lag); n < size - std::max(0, lag); ++n)
          sum += left[static_cast<std::size_t>(n)] * right[static_cast<std::size_t>(n + lag)];
        return sum;
      };
      int best = 0;
      for (int lag = -60; lag <= 60; ++lag)
        if (at(lag) > at(best)) best = lag;
      const double below = at(best - 1), here = at(best), above = at(best + 1);
      return best + 0.5 * (below - above) / (below - 2 * here + above);
    }
  };
  [[nodiscard]] Ears hear(const std::string& head, glm::dvec3 towards, double distance_m) const {
    const CliOutcome outcome = earshot(command(head, towards, distance_m, "ears.wav"));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    Ears ears;
    const std::vector<float> samples = read_wav("ears.wav");
    const std::size_t first = static_cast<std::size_t>(std::max(0.0, distance_m / 343.0 * rate_hz_ - 100));
    for (std::size_t i = first; i < first + 1400 && 2 * i + 1 < samples.size(); ++i) {
      ears.left.push_back(static_cast<double>(samples[2 * i]));
      ears.right.push_back(static_cast<double>(samples[2 * i + 1]));
    }
    return ears;
  }
  /// Largest difference between what two heads hear, over the largest sample.
  [[nodiscard]] static double difference(const Ears& a, const Ears& b) {
    double largest = 0, apart = a.left.size() == b.left.size() ? 0 : 1e9;
    for (std::size_t i = 0; i < a.left.size() && i < b.left.size(); ++i) {
      largest = std::max({largest, std::abs(a.left[i]), std::abs(a.right[i])});
      apart = std::max({apart, std::abs(a.left[i] - b.left[i]), std::abs(a.right[i] - b.right[i])});
    }
    return apart / largest;
  }
  [[nodiscard]] std::string given(const std::string& name) const { return (data_folder() / name).string(); }
  std::string made(const MadeHead& head, const std::string& name = "head.sofa") const { return write(name, head.bytes()); }

  int rate_hz_ = 16000;
};

constexpr glm::dvec3 kLeft{0, 1, 0};

// field/README.md: +11.8 dB and 31.9 samples.  0.5 dB and a sample: the broadband figures of a head between rate conversion and air.
TEST_F(HeadFiles, TheFirstApiExchangesLabelsNotEars) {
  SKIP_WITHOUT_DATA("field/MIT_KEMAR_normal_pinna.old.sofa");
  rate_hz_ = 44100;
  for (const char* name : {"field/MIT_KEMAR_normal_pinna.old.sofa", "hrtf/MIT_KEMAR_normal_pinna.sofa"}) {
    const Ears ears = hear(given(name), kLeft, 5);
    EXPECT_NEAR(ears.level_db(), 11.8, 0.5) << name;
    EXPECT_NEAR(ears.lead_samples(), 31.9, 3.0) << name;
  }
}

// Which ear comes first in the data, and which is named first: by chance; the second microphone has another gain.  The closed form of the
// made head to 0.3 dB and 10 us, in a direction that it has.
TEST_F(HeadFiles, TheNearerEarIsTheNearerEarInMadeHeads) {
  for (std::uint32_t i = 0; i < 10; ++i) {
    MadeHead head;
    head.right_named_first = i > 0;
    head.right_stored_first = i > 0 && draw(31, i, 0, 1) < 0.5;
    head.second_gain = i < 5 ? 1.0 : draw(32, i, 0.7, 1.4);
    head.early_samples = draw(33, i, 6, 16);
    head.add_sphere(128, 2.0, draw(34, i, 0.3, 0.7));
    const double level = head.measurements[0].level, lateral = draw(35, i, 0.5, 1.0);
    const glm::dvec3 towards(std::sqrt(1 - lateral * lateral), lateral, 0);
    head.measurements.push_back({2.0 * towards, level});
    const Ears ears = hear(made(head), towards, 5);
    const double gain_db = 20 * std::log10(head.second_gain) * (head.right_stored_first ? 1 : -1);
    EXPECT_NEAR(ears.level_db(), head.level_db(lateral, level) + gain_db, 0.3) << i;
    EXPECT_NEAR(ears.lead_samples() / rate_hz_ * 1e6, head.lead_s(lateral) * 1e6, 10) << i;
  }
}

// Labels that name the left ear first count, and a line says that the data contradict them.
TEST_F(HeadFiles, ExchangedDataAreKeptAndNamed) {
  MadeHead head;
  head.right_stored_first = true;
  head.add_sphere(100, 2.0, 0.5);
  const CliOutcome outcome = earshot(command(made(head), kLeft, 5, "ears.wav"));
  EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
  // The log is on the standard output of this command.
  EXPECT_THAT(outcome.output + outcome.errors,
              testing::ContainsRegex("head.sofa: a source on the left is [^\n]* louder [^\n]* at the right ear; check whether"));
}

TEST_F(HeadFiles, ASourceTakesTheSphereOfItsDistance) {
  SKIP_WITHOUT_DATA("field/c10_two_spheres.sofa");
  rate_hz_ = 44100;
  EXPECT_NEAR(hear(given("field/c10_two_spheres.sofa"), kLeft, 5).level_db(), 11.8, 0.5);
  EXPECT_NEAR(hear(given("field/c10_two_spheres.sofa"), kLeft, 0.2).level_db(), 29.8, 0.5);
  const glm::dvec3 aside(0.6, 0.8, 0);
  EXPECT_LT(difference(hear(given("field/c10_same_2_distances.sofa"), aside, 5), hear(given("hrtf/MIT_KEMAR_normal_pinna.sofa"), aside, 5)),
            1e-4);
}

// Spheres at two or three distances drawn at random, with some further measurements on a ring, which is not a sphere.
TEST_F(HeadFiles, MadeSpheresAreChosenAndInterpolated) {
  for (std::uint32_t i = 0; i < 10; ++i) {
    MadeHead head;
    const double near_m = draw(41, i, 0.25, 0.5), far_m = near_m * draw(42, i, 1.8, 4);
    head.add_sphere(150, near_m, 0.7);
    head.add_sphere(i % 2 ? 150 : 90, far_m, 0.3);
    head.measurements.push_back({near_m * kLeft, 0.7});
    head.measurements.push_back({far_m * kLeft, 0.3});
    if (i % 3 == 0)
      for (int a = 0; a < 24; ++a)
        head.measurements.push_back({0.5 * (near_m + far_m) * glm::dvec3(std::cos(a * 0.2618), std::sin(a * 0.2618), 0), 0.95});
    const std::string name = made(head);
    const double far_db = hear(name, kLeft, 5).level_db(), near_db = hear(name, kLeft, near_m).level_db();
    EXPECT_NEAR(far_db, head.level_db(1, 0.3), 0.3) << i;
    EXPECT_NEAR(near_db, head.level_db(1, 0.7), 0.3) << i;
    if (i >= 3) continue;
    // Linear in 1 / distance: about half way there, as each sphere has the mean power of the rigid one.
    const double between_db = hear(name, kLeft, 2 / (1 / near_m + 1 / far_m)).level_db();
    EXPECT_GT(between_db, far_db + 0.2 * (near_db - far_db)) << i;
    EXPECT_LT(between_db, far_db + 0.8 * (near_db - far_db)) << i;
  }
}

TEST_F(HeadFiles, CopiesOfADirectionCountOnce) {
  MadeHead head;
  head.add_sphere(100, 1.5, 0.5);
  head.measurements.push_back({{0, 0, 1.5}, 0.5});
  const glm::dvec3 towards(std::sin(0.15), 0, std::cos(0.15));
  const Ears plain = hear(made(head), towards, 5);
  for (std::uint32_t i = 0; i < 10; ++i) {
    MadeHead copies = head;
    copies.spherical = i % 2 == 1;
    for (int copy = 1; copy < 36; ++copy) copies.measurements.push_back(head.measurements[100]);
    for (std::uint32_t c = 0; c < 12; ++c)
      copies.measurements.push_back(head.measurements[static_cast<std::size_t>(draw(51, 12 * i + c, 0, 99.9))]);
    EXPECT_LT(difference(plain, hear(made(copies), towards, 5)), 1e-4) << i;
  }
}

TEST_F(HeadFiles, TheListenerIsWhereTheFileSays) {
  MadeHead head;
  head.add_sphere(120, 1.5, 0.5);
  const std::string upright = made(head, "upright.sofa");
  std::vector<Ears> plain;
  for (std::uint32_t d = 0; d < 3; ++d) plain.push_back(hear(upright, draw_direction(65, d), 5));
  for (std::uint32_t i = 0; i < 10; ++i) {
    MadeHead turned = head;
    turned.position = 3.0 * draw_direction(62, i);
    turned.view = draw_direction(63, i);
    turned.up = draw_direction(64, i);
    turned.up -= glm::dot(turned.up, turned.view) * turned.view;
    turned.spherical = i % 2 == 1;
    EXPECT_LT(difference(plain[i % 3], hear(made(turned), draw_direction(65, i % 3), 5)), 1e-3) << i;
  }
  SKIP_WITHOUT_DATA("field/c11_cartesian.sofa");
  for (std::uint32_t i = 0; i < 2; ++i) {
    const glm::dvec3 towards = draw_direction(61, i);
    EXPECT_LT(
        difference(hear(given("field/c11_cartesian.sofa"), towards, 5), hear(given("field/c11_listener_off_origin.sofa"), towards, 5)),
        1e-3);
  }
}

TEST_F(HeadFiles, OtherConventionsAreRefusedByName) {
  MadeHead head;
  head.add_sphere(40, 1.5, 0.5);
  for (const auto& [convention, data_type, contents] : {std::tuple{"SimpleFreeFieldHRTF", "TF", "transfer functions"},
                                                        {"SimpleFreeFieldTF", "TF", "transfer functions"},
                                                        {"GeneralTF", "TF", "transfer functions"},
                                                        {"SimpleFreeFieldSOS", "SOS", "second-order sections"},
                                                        {"SimpleFreeFieldHRSOS", "SOS", "second-order sections"},
                                                        {"FreeFieldDirectivityTF", "TF", "directivity of a source"},
                                                        {"SimpleHeadphoneIR", "FIR", "headphone"},
                                                        {"SingleRoomSRIR", "FIR", "room"},
                                                        {"MultiSpeakerBRIR", "FIR", "room"},
                                                        {"SingleTrackedAudio", "Audio", "recording"}}) {
    head.convention = convention;
    head.data_type = data_type;
    const std::string name = made(head);
    expect_bad_input(command(name, kLeft, 5, "x.wav"), std::string("(SOFA convention ") + convention + ")");
    EXPECT_THAT(read("stderr"), HasSubstr(contents));
    EXPECT_FALSE(std::filesystem::exists(file("x.wav")));
  }
}

TEST_F(HeadFiles, ACutFileIsRefused) {
  MadeHead head;
  head.add_sphere(40, 1.5, 0.5);
  std::vector<std::string> wholes{head.bytes()};
  for (const char* name : {"field/MIT_KEMAR_normal_pinna.old.sofa", "field/c11_listener_off_origin.sofa"})
    if (std::filesystem::exists(given(name))) wholes.push_back(read_file(given(name)));
  for (std::uint32_t w = 0; w < wholes.size(); ++w)
    for (std::uint32_t i = 0; i < 20; ++i) {
      const auto size = static_cast<std::size_t>(draw(70 + w, i, 0, 1) * static_cast<double>(wholes[w].size()));
      write("cut.sofa", wholes[w].substr(0, size));
      expect_bad_input(command(file("cut.sofa"), kLeft, 5, "x.wav"), "cut.sofa");
    }
}

}  // namespace
}  // namespace earshot

#endif
