// SPDX-License-Identifier: Apache-2.0
// Parameters of ISO 3382-1 do not depend on the ear: `rir --metrics` measures an omnidirectional microphone, and ears by name beside it.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>

#include "sim/base/random.h"
#include "sim/base/text/json.h"
#include "tests/support/files/drawn_room.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

class RirMetricsCli : public Cli {
 protected:
  [[nodiscard]] nlohmann::json metrics(const std::string& arguments) const {
    const CliOutcome outcome = earshot("rir " + arguments + " --out " + file("r.wav") + " --metrics " + file("r.json"));
    EXPECT_EQ(outcome.exit_code, 0) << arguments << "\n" << outcome.errors;
    return parse_json(read("r.json"));
  }
};

/// A shoebox with a listener in its plane of symmetry, and a source at one side or at its mirror image.
struct MirroredPair {
  std::string room, left, right;

  MirroredPair(double width_m, double height_m, double depth_m, glm::dvec3 listener, double aside_m, glm::dvec3 source) {
    room = fmt::format("shoebox:{:.3f}x{:.3f}x{:.3f}@0.25 --preset fast --set rays=2048 rir_length_s=0.5 --listener {}", width_m, height_m,
                       depth_m, point_text({0.5 * width_m, listener.y, listener.z}));
    left = " --source " + point_text({0.5 * width_m - aside_m, source.y, source.z});
    right = " --source " + point_text({0.5 * width_m + aside_m, source.y, source.z});
  }
  static MirroredPair drawn(std::uint32_t number) {
    const RandomStream random(7, Purpose::test, number);
    const auto within = [&](std::uint32_t draw, double low, double high) {
      return low + (high - low) * static_cast<double>(random.uniform(draw));
    };
    const double width_m = within(0, 4, 9), height_m = within(1, 2.5, 4), depth_m = within(2, 4, 9);
    return {width_m,
            height_m,
            depth_m,
            {0, within(3, 1, 1.8), depth_m * within(4, 0.3, 0.7)},
            width_m * within(5, 0.2, 0.4),
            {0, within(6, 1, 1.8), depth_m * within(7, 0.3, 0.7)}};
  }
};

// The noise of the traces and carriers is 0.3 dB of DRR; a source at one side is 2 to 8 dB apart between the ears.
TEST_F(RirMetricsCli, MirroredSetUpsDifferInTheirEarsAlone) {
  double largest_between_ears_db = 0;
  for (std::uint32_t number = 0; number <= 10; ++number) {
    const MirroredPair pair = number == 0 ? MirroredPair(5, 3, 4, {2.5, 1.6, 2.3}, 1.3, {0, 1.1, 1.5}) : MirroredPair::drawn(number);
    const nlohmann::json left = metrics(pair.room + pair.left), right = metrics(pair.room + pair.right),
                         mono = metrics(pair.room + pair.left + " --channels mono");
    const auto drr = [](const nlohmann::json& metrics) { return metrics.at("drr_db").get<double>(); };
    EXPECT_NEAR(drr(left.at("rir")), drr(right.at("rir")), 1.0) << number;
    EXPECT_NEAR(drr(left.at("rir")), drr(mono.at("rir")), 1.0) << number;
    EXPECT_NEAR(drr(left.at("ears").at("left")), drr(right.at("ears").at("right")), 1.5) << number;
    EXPECT_NEAR(drr(left.at("ears").at("right")), drr(right.at("ears").at("left")), 1.5) << number;
    largest_between_ears_db = std::max(largest_between_ears_db, drr(left.at("ears").at("left")) - drr(left.at("ears").at("right")));
    for (std::size_t band = 2; band < 6; ++band)  // 500 Hz to 4 kHz
      EXPECT_NEAR(left.at("rir").at("c80_db").at(band).get<double>(), right.at("rir").at("c80_db").at(band).get<double>(), 1.5)
          << number << " " << band;
    EXPECT_TRUE(left.at("rir").at("iacc").at(4).is_number());  // between the ears
    EXPECT_FALSE(mono.contains("ears"));
    EXPECT_FALSE(left.at("ears").at("left").contains("iacc"));
  }
  EXPECT_GT(largest_between_ears_db, 4) << "the test sees what it is for";
}

// Microphones of an array are named; the parameters are those of the place all the same.
TEST_F(RirMetricsCli, MicrophonesAreMeasuredByName) {
  write("array.yaml",
        "microphones:\n  - {name: front, position_m: [0, 0, -0.05], pattern: cardioid, azimuth_deg: 0}\n"
        "  - {name: back, position_m: [0, 0, 0.05], pattern: cardioid, azimuth_deg: 180}\n");
  const std::string room =
      "shoebox:6x3x7@0.25 --preset fast --set rays=1024 rir_length_s=0.4 --source 3,1.5,1.5 --listener 3,1.5,4.5 --channels ";
  const nlohmann::json array = metrics(room + "array:" + file("array.yaml")), mono = metrics(room + "mono");
  EXPECT_NEAR(array.at("rir").at("drr_db").get<double>(), mono.at("rir").at("drr_db").get<double>(), 1.0);
  EXPECT_GT(array.at("microphones").at("front").at("drr_db").get<double>(),
            array.at("microphones").at("back").at("drr_db").get<double>() + 6);
  const nlohmann::json harmonics = metrics(room + "ambisonic:1");
  EXPECT_NEAR(harmonics.at("rir").at("drr_db").get<double>(), mono.at("rir").at("drr_db").get<double>(), 1.0);
  EXPECT_FALSE(harmonics.contains("microphones"));
}

// With a source field every parameter has the error of its own place.  Two seeds in ten drawn rooms; errors have Student's factor for seven
// degrees of freedom, so that differences are 0.84 of what is stated: half of that or twice that fails.
TEST_F(RirMetricsCli, ErrorsOfAFieldAreTheDifferencesOfSeeds) {
  double squares = 0;
  int values = 0;
  for (std::uint32_t number = 0; number < 10; ++number) {
    const RandomStream random(621, Purpose::test, number);
    const auto within = [&](std::uint32_t draw, double low, double high) {
      return low + (high - low) * static_cast<double>(random.uniform(draw));
    };
    const double x_m = within(0, 4, 9), y_m = within(1, 2.5, 4), z_m = within(2, 4, 9);
    const std::string room =
        fmt::format("shoebox:{:.3f}x{:.3f}x{:.3f}@{:.3f} --preset fast --channels mono --source {} --listener {} ", x_m, y_m, z_m,
                    within(3, 0.15, 0.4), point_text({0.2 * x_m, 0.5 * y_m, 0.3 * z_m}), point_text({0.8 * x_m, 0.4 * y_m, 0.7 * z_m}));
    std::array<nlohmann::json, 2> seeds;
    for (std::size_t seed = 0; seed < 2; ++seed)
      seeds[seed] = metrics(room + fmt::format("--seed {} --set field=on bands=1 rir_length_s=0.6 threads=1", seed + 1));
    for (const char* key : {"t20_s", "edt_s", "g_db", "c80_db"}) {
      const auto value = [&](std::size_t seed) { return seeds[seed].at("energy").at(key).at(0).get<double>(); };
      const auto error = [&](std::size_t seed) { return seeds[seed].at("standard_error").at(key).at(0).get<double>(); };
      const double ratio = (value(0) - value(1)) / std::hypot(error(0), error(1));
      EXPECT_LT(std::abs(ratio), 4) << number << " " << key;
      squares += ratio * ratio;
      ++values;
    }
  }
  const double deviation = std::sqrt(squares / values);
  std::printf("differences of %.2f stated errors\n", deviation);
  EXPECT_GT(deviation, 0.45);
  EXPECT_LT(deviation, 1.4);
}

// Errors of IACC stand beside its values, with an octave at 63 Hz too.
TEST_F(RirMetricsCli, ErrorsOfIaccHaveTheOctavesOfIacc) {
  for (const char* low : {"false", "true"}) {
    const nlohmann::json json = metrics(std::string("shoebox:5x4x3@0.3 --preset fast --source 1.2,1.5,1.1 --listener 3.8,1.6,2.3 "
                                                    "--parameters interaural --set rir_length_s=0.2 low_octave=") +
                                        low);
    for (const char* key : {"iacc", "iacc_early", "iacc_late"})
      EXPECT_EQ(json["standard_error"][key].size(), json["rir"][key].size()) << low << " " << key;
  }
}

}  // namespace
}  // namespace earshot
