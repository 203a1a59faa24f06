// SPDX-License-Identifier: Apache-2.0
// A material that reflects by the angle, as `earshot rir` hears it.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <nlohmann/json.hpp>
#include <string>

#include "sim/base/random.h"
#include "sim/scene/materials/wall_impedance.h"
#include "tests/support/programs/rir_cli.h"

namespace earshot {
namespace {

class LocallyReactingCli : public RirCli {
 protected:
  /// A floor of 400 m with a material of these keys.
  void write_floor(const std::string& keys) const {
    write("floor.obj", "usemtl floor\nv -200 0 -200\nv -200 0 200\nv 200 0 200\nv 200 0 -200\nf 1 2 3\nf 1 3 4\n");
    write("walls.json", fmt::format(R"({{"materials": [{{"name": "floor", "labels": ["default"], "scattering": [500, 0], {}}}]}})", keys));
    write("scene.yaml", "mesh: floor.obj\nmaterials: walls.json\n");
  }
};

// The level of the image alone, each octave by the impedance at its centre: 0.02 dB.
TEST_F(LocallyReactingCli, TheFloorReflectsByTheAngle) {
  for (std::uint32_t number = 0; number < 10; ++number) {
    const RandomStream random(41, Purpose::test, number);
    const auto within = [&](std::uint32_t draw, double low, double high) {
      return low + (high - low) * static_cast<double>(random.uniform(draw));
    };
    const double height_m = within(0, 0.2, 4), apart_m = within(1, 1, 20), absorption = within(2, 0.1, 0.9);
    const std::complex<double> measured(within(3, 0.5, 6), within(4, -6, 6));
    const bool by_absorption = number % 2 == 0;
    write_floor(by_absorption ? fmt::format(R"("absorption": [500, {}], "angle": "locally_reacting")", absorption)
                              : fmt::format(R"("impedance": [500, {}, {}])", measured.real(), measured.imag()));
    const nlohmann::json heard =
        metrics(fmt::format("{} --source 0,{},0 --listener {},{},0 --set direct=off late=off diffraction=off air_absorption=off",
                            file("scene.yaml"), height_m, apart_m, height_m));
    const double distance_m = std::hypot(apart_m, 2 * height_m);
    const auto impedance = by_absorption ? std::complex<double>(impedance_of_absorption(absorption)) : measured;
    const double expected_db = 20 * std::log10(std::abs(wall_reflection(impedance, 2 * height_m / distance_m)) * 10 / distance_m);
    for (std::size_t band = 0; band < heard["bands_hz"].size(); ++band)
      EXPECT_NEAR(heard["energy"]["g_db"][band].get<double>(), expected_db, 0.02) << number << ", band " << band;
  }
}

TEST_F(LocallyReactingCli, AnAbsorptionBesideAnImpedanceIsRefused) {
  write_floor(R"("impedance": [500, 2, 1], "absorption": [500, 0.2])");
  const CliOutcome outcome = earshot("scene " + file("scene.yaml"));
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_THAT(outcome.errors, testing::HasSubstr("follows from the impedance"));
}

TEST_F(LocallyReactingCli, LobesAreRefusedInOneLine) {
  write_floor(R"("absorption": [500, 0.3], "angle": "locally_reacting")");
  for (const char* exponent : {"1", "20", "from_scattering"}) {
    const CliOutcome outcome = earshot(fmt::format("rir {} --source 0,1,0 --listener 3,1,0 --set specular_exponent={} --out {}",
                                                   file("scene.yaml"), exponent, file("r.wav")));
    EXPECT_EQ(outcome.exit_code, 2);
    EXPECT_THAT(outcome.errors, testing::HasSubstr("specular_exponent"));
    EXPECT_THAT(outcome.errors, testing::HasSubstr("angle: locally_reacting"));
  }
}

}  // namespace
}  // namespace earshot
