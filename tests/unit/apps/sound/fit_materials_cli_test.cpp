// SPDX-License-Identifier: Apache-2.0
// `earshot fit-materials`: coefficients from responses at known places.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "sim/base/text/json.h"
#include "tests/support/files/measured_room_files.h"
#include "tests/support/files/test_data.h"

namespace earshot {
namespace {

class FitMaterialsCli : public MeasuredRoomFiles {
 protected:
  /// A material file with a floor and walls of these absorptions at 250 Hz and 4 kHz.
  std::string materials(const std::string& name, double floor_low, double floor_high, double walls_low, double walls_high) const {
    return write(name, fmt::format(R"({{"materials": [
 {{"name": "floor", "absorption": [250, {}, 4000, {}], "scattering": [125, 0.4], "source": "test"}},
 {{"name": "walls", "absorption": [250, {}, 4000, {}], "scattering": [125, 0.4], "source": "test"}}]}})",
                                   floor_low, floor_high, walls_low, walls_high));
  }
  std::string scene(const std::string& name, const std::string& material_file) const {
    return write(name, "mesh: shoebox:6x2.6x4.5@walls,walls,floor,walls,walls,walls\nmaterials: " + material_file + "\n");
  }
};

// Responses of known coefficients, simulated under other seeds; the search begins far away.
TEST_F(FitMaterialsCli, FindsTheCoefficientsBehindResponses) {
  materials("truth.json", 0.5, 0.8, 0.08, 0.2);
  materials("start.json", 0.25, 0.25, 0.25, 0.25);
  measure_box("room", scene("truth.yaml", "truth.json"), {6, 2.6, 4.5}, 8, 421);
  const nlohmann::json report =
      report_of("fit-materials " + scene("start.yaml", "start.json") + " --measured " + file("room") +
                " --preset balanced --keep-scattering --materials walls,floor --starts 8 --rounds 6 --out " + file("fitted.json"));
  const auto bands = report.at("bands_hz").get<std::vector<double>>();
  ASSERT_EQ(bands.size(), 5u);
  // Floor of 27 m2, ceiling and walls of 81.6 m2.
  std::vector<double> found_m2(bands.size()), true_m2(bands.size());
  for (const nlohmann::json& material : report.at("materials")) {
    const bool is_floor = material.at("name") == "floor";
    for (std::size_t b = 0; b < bands.size(); ++b) {
      // Between its points a curve is straight over log f.
      const double along = std::clamp(std::log(bands[b] / 250) / std::log(16.0), 0.0, 1.0);
      const double truth = is_floor ? 0.5 + 0.3 * along : 0.08 + 0.12 * along;
      const double found = material.at("absorption").at(b), error = material.at("absorption_standard_error").at(b);
      EXPECT_GT(error, 0) << material.at("name");
      EXPECT_LT(error, is_floor ? 0.3 : 0.15) << material.at("name") << " " << bands[b];
      EXPECT_NEAR(found, truth, 3 * error + 0.02) << material.at("name") << " " << bands[b];
      found_m2[b] += (is_floor ? 27.0 : 81.6) * found;
      true_m2[b] += (is_floor ? 27.0 : 81.6) * truth;
    }
  }
  // Responses tell how much is absorbed far better than where.
  for (std::size_t b = 0; b < bands.size(); ++b) EXPECT_NEAR(found_m2[b] / true_m2[b], 1, 0.15) << bands[b];
  EXPECT_GT(report.at("before").at("t20_percent").at("error").get<double>(), 15);
  EXPECT_LT(report.at("fitted").at("t20_percent").at("error").get<double>(), 5);
  EXPECT_LT(report.at("fitted").at("drr_db").at("error").get<double>(), 1);
  // The file is one that a scene takes, and gives the same agreement.
  const nlohmann::json again =
      report_of("validate " + file("room") + " --scene " + scene("again.yaml", "fitted.json") + " --preset balanced");
  EXPECT_NEAR(again.at("mean").at("t20_percent").at("error").get<double>(), report.at("fitted").at("t20_percent").at("error").get<double>(),
              0.3);
  EXPECT_THAT(read("fitted.json"), testing::HasSubstr("standard errors"));
}

// A record is one draw: its DRR scatters by 0.7 dB in the mean of sizes over four octaves (validate_cli_test.cpp).
TEST_F(FitMaterialsCli, PredictsPlacesThatItDidNotSee) {
  materials("truth.json", 0.6, 0.6, 0.12, 0.12);
  materials("start.json", 0.3, 0.3, 0.3, 0.3);
  measure_box("room", scene("truth.yaml", "truth.json"), {6, 2.6, 4.5}, 8, 422);
  const nlohmann::json report = report_of("fit-materials " + scene("start.yaml", "start.json") + " --measured " + file("room") +
                                          " --preset balanced --starts 6 --rounds 4 --folds 4 --out " + file("fitted.json"));
  EXPECT_EQ(report.at("held_out").at("places").size(), 8u);
  EXPECT_LT(report.at("held_out").at("mean").at("t20_percent").at("error").get<double>(), 8);
  EXPECT_LT(report.at("held_out").at("mean").at("drr_db").at("error").get<double>(), 1);
}

TEST_F(FitMaterialsCli, RefusesWhatCannotBeFitted) {
  materials("start.json", 0.3, 0.3, 0.3, 0.3);
  measure_box("room", "shoebox:6x2.6x4.5@0.3", {6, 2.6, 4.5}, 2, 423);
  const std::string begin =
      "fit-materials " + scene("start.yaml", "start.json") + " --measured " + file("room") + " --out " + file("f.json");
  expect_bad_input(begin + " --materials wall", "did you mean 'walls'");
  expect_bad_input(begin + " --materials walls,walls", "twice");
  expect_bad_input(begin + " --folds 3", "for 2 responses");
  expect_bad_input(begin + " --set bands=24", "octaves");
  expect_bad_input("fit-materials " + file("start.yaml") + " --measured " + file("nowhere") + " --out " + file("f.json"), "nowhere");
  write(
      "impedance.json",
      R"({"materials": [{"name": "floor", "impedance": [125, 3, 1, 4000, 2, 0], "angle": "locally_reacting", "scattering": [125, 0.1], "source": "t"},
 {"name": "walls", "absorption": [125, 0.2], "scattering": [125, 0.1], "source": "t"}]})");
  expect_bad_input(
      "fit-materials " + scene("impedance.yaml", "impedance.json") + " --measured " + file("room") + " --out " + file("f.json"),
      "impedance");
  EXPECT_FALSE(std::filesystem::exists(file("f.json")));
}

// The measured room of dEchorate: places that were not fitted.  Bounds: the paper of SoundSpaces 2.0 has 12.4 % of RT60 and 0.98 dB of DRR
// where it fitted its materials to the same measurements; the spread of single octaves adds to what is held out.
TEST_F(FitMaterialsCli, DEchorateFromTheOtherPlaces) {
  SKIP_WITHOUT_DATA("rir/dechorate/dechorate_011111.json");
  const std::string configs = (source_dir() / "configs").string();
  const nlohmann::json report =
      report_of("fit-materials " + configs + "/scenes/dechorate.yaml --measured " + (data_folder() / "rir/dechorate").string() +
                " --places " + configs + "/measured/dechorate.yaml --preset balanced --folds 6 --out " + file("fitted.json"));
  const nlohmann::json& mean = report.at("held_out").at("mean");
  EXPECT_LT(mean.at("t20_percent").at("error").get<double>(), 8);
  EXPECT_LT(mean.at("drr_db").at("error").get<double>(), 1.3);
  EXPECT_LT(report.at("fitted").at("t20_percent").at("error").get<double>(),
            report.at("before").at("t20_percent").at("error").get<double>());
}

}  // namespace
}  // namespace earshot
