// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/materials/materials.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <nlohmann/json.hpp>
#include <set>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"
#include "sim/scene/materials/material_keys.h"
#include "tests/support/files/test_files.h"
#include "tests/support/files/test_paths.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

std::string error_of(const std::string& json) {
  return message_of<InputError>([&] { MaterialDatabase::from_json(json, "db.json"); });
}

std::string with_entry(const std::string& keys) { return R"({"materials": [{"name": "felt", )" + keys + "}]}"; }

// docs/evidence/oracles.md, O-31.
TEST(CoefficientCurve, BandMeanIsTheMeanOverLogFrequency) {
  const CoefficientCurve curve{{125, 4000}, {0.1f, 0.6f}};
  EXPECT_NEAR(curve.band_mean(44.194f, 11313.7f), 0.35f, 1e-5f) << "symmetric around 707.1 Hz on a log axis";
  EXPECT_NEAR(curve.band_mean(500, 1000), 0.35f, 1e-5f);
  EXPECT_NEAR(curve.band_mean(125, 250), 0.15f, 1e-5f) << "0.1 per octave: 0.1 to 0.2";
  EXPECT_NEAR(curve.band_mean(20, 60), 0.1f, 1e-6f) << "held below";
  EXPECT_NEAR(curve.band_mean(62.5f, 250), 0.5f * (0.1f + 0.15f), 1e-5f) << "one octave held, one rising";
  EXPECT_FLOAT_EQ(curve.band_mean(500, 500), curve.at(500));
}

TEST(CoefficientCurve, ValueIsLinearInLogFrequencyAndHeldOutside) {
  const CoefficientCurve curve{{100, 200, 800}, {0.f, 1.f, 0.5f}};
  EXPECT_FLOAT_EQ(curve.at(100 * std::sqrt(2.f)), 0.5f);
  EXPECT_FLOAT_EQ(curve.at(400), 0.75f);
  EXPECT_EQ(curve.at(1), 0.f);
  EXPECT_EQ(curve.at(200), 1.f);
  EXPECT_EQ(curve.at(20000), 0.5f);
  EXPECT_EQ(CoefficientCurve{}.at(500), 0.f);
  EXPECT_EQ(CoefficientCurve::constant(0.3f).band_mean(20, 20000), 0.3f);
}

TEST(MaterialDatabase, ReadsEveryKey) {
  const MaterialDatabase database = MaterialDatabase::from_json(R"({"materials": [
    {"name": "Felt", "labels": ["rug", "Wall Hanging"], "absorption": [4000, 0.5, 125, 0.2, 125, 0.1], "scattering": [1000, 0.25],
     "transmission": [125, 0.05], "damping": [125, 3], "speed": 343, "density": 12.5, "source": "a book"}]})",
                                                                "db");
  const Material& felt = database.get("Felt", "test");
  EXPECT_THAT(felt.absorption.hz, testing::ElementsAre(125, 4000)) << "sorted; of equal frequencies the last wins";
  EXPECT_FLOAT_EQ(felt.absorption.at(125), 0.1f);
  EXPECT_FLOAT_EQ(felt.scattering.at(31), 0.25f);
  EXPECT_FLOAT_EQ(felt.transmission.at(8000), 0.05f);
  EXPECT_FLOAT_EQ(felt.damping_db_per_m.at(500), 3);
  EXPECT_EQ(felt.speed_m_per_s, 343);
  EXPECT_EQ(felt.density_kg_per_m3, 12.5f);
  EXPECT_EQ(felt.source, "a book");
}

TEST(MaterialDatabase, SourceMayBeOneTextPerKey) {
  const std::string curves = R"("absorption": [125, 0.2], "scattering": [125, 0.1])";
  const MaterialDatabase database =
      MaterialDatabase::from_json(with_entry(curves + R"(, "source": {"absorption": "a book", "scattering": "derived: a guess"})"), "db");
  const Material& felt = database.all()[0];
  EXPECT_EQ(felt.source_of("absorption"), "a book");
  EXPECT_EQ(felt.source_of("scattering"), "derived: a guess");
  EXPECT_EQ(felt.source, "absorption: a book; scattering: derived: a guess");
  const MaterialDatabase plain = MaterialDatabase::from_json(with_entry(curves + R"(, "source": "a book")"), "db");
  EXPECT_EQ(plain.all()[0].source_of("scattering"), "a book");
  EXPECT_THAT(error_of(with_entry(curves + R"(, "source": {"absorbtion": "a"})")), HasSubstr("did you mean 'absorption'"));
  EXPECT_THAT(error_of(with_entry(curves + R"(, "source": {"absorption": 3})")), HasSubstr("absorption"));
}

// docs/evidence/oracles.md, O-15: R_E = (1 - a)^2, and every transmission loss doubles in dB.
TEST(MaterialDatabase, PressureReadingSquaresTheReflection) {
  const std::string entry =
      R"("materials": [{"name": "felt", "absorption": [125, 0.1, 4000, 0.6], "scattering": [125, 0.3], "transmission": [125, 0.01]}]})";
  const std::string plain = "{" + entry, marked = R"({"coefficients": "pressure", )" + entry;
  const MaterialImport pressure{.reading = CoefficientReading::pressure}, energy{.reading = CoefficientReading::energy};
  for (const MaterialDatabase& database : {MaterialDatabase::from_json(plain, "db", pressure), MaterialDatabase::from_json(marked, "db"),
                                           MaterialDatabase::from_json(marked, "db", pressure)}) {
    const Material& felt = database.all()[0];
    EXPECT_FLOAT_EQ(felt.absorption.at(125), 0.19f);
    EXPECT_FLOAT_EQ(felt.absorption.at(4000), 0.84f);
    EXPECT_FLOAT_EQ(felt.scattering.at(125), 0.3f);
    EXPECT_FLOAT_EQ(felt.transmission.at(125), 1e-4f);
  }
  EXPECT_FLOAT_EQ(MaterialDatabase::from_json(plain, "db").all()[0].absorption.at(125), 0.1f) << "energy is the default";
  EXPECT_FLOAT_EQ(MaterialDatabase::from_json(plain, "db", energy).all()[0].transmission.at(125), 0.01f);
  EXPECT_THAT(message_of<InputError>([&] { MaterialDatabase::from_json(marked, "db", energy); }), HasSubstr("than the scene"));
  EXPECT_THAT(error_of(R"({"coefficients": "volts", "materials": []})"), HasSubstr("pressure"));
}

// docs/reference/formats.md, section 2: what the predecessor does, on request.
TEST(MaterialDatabase, SubstringMatchingCountsLabels) {
  const MaterialDatabase database = MaterialDatabase::from_json(R"({"materials": [
    {"name": "Default", "labels": ["default"], "absorption": [125, 0.1], "scattering": [125, 0.1]},
    {"name": "wood, Thick", "labels": ["table", "stairs"], "absorption": [125, 0.1], "scattering": [125, 0.1]},
    {"name": "Wood Floor", "labels": ["stair"], "absorption": [125, 0.1], "scattering": [125, 0.1]},
    {"name": "Gypsum Board", "labels": ["wall"], "absorption": [125, 0.1], "scattering": [125, 0.1]},
    {"name": "Carpet", "labels": ["floor", "floor"], "absorption": [125, 0.1], "scattering": [125, 0.1]},
    {"name": "Lamp", "labels": ["wall-lamp", "lamp"], "absorption": [125, 0.1], "scattering": [125, 0.1]}]})",
                                                                "db");
  const auto name = [&](const char* category) {
    const Material* found = database.find_by_substrings(category);
    return found ? found->name : "";
  };
  EXPECT_EQ(name("vegetable"), "wood, Thick") << "the predecessor's table in a vegetable";
  EXPECT_EQ(name("Wall-Lamp"), "Lamp") << "two labels beat one";
  EXPECT_EQ(name("wall-floor"), "Carpet") << "a label listed twice counts twice";
  EXPECT_EQ(name("stairs"), "wood, Thick") << "a tie: the first in the file";
  EXPECT_EQ(name("gypsum board"), "") << "names do not count";
  for (const char* category : {"vegetable", "wall-lamp", "wall/lamp"}) EXPECT_TRUE(!database.find_label(category) || category[4] == '-');
}

// Whole words: the predecessor matched `table` inside `vegetable` (docs/reference/formats.md, section 2).
TEST(MaterialDatabase, LabelsMatchAsWholesWithoutCase) {
  const MaterialDatabase database = MaterialDatabase::from_json(
      R"({"materials": [{"name": "a", "labels": ["table"], "absorption": [125, 0.1], "scattering": [125, 0.1]}]})", "db");
  ASSERT_NE(database.find_label("TABLE"), nullptr);
  EXPECT_EQ(database.find_label("TABLE")->name, "a");
  for (const char* other : {"vegetable", "tables", "tab", "", "a"}) EXPECT_EQ(database.find_label(other), nullptr) << other;
}

TEST(MaterialDatabase, UnknownNameSuggestsTheNearest) {
  const std::string message =
      message_of<InputError>([] { static_cast<void>(MaterialDatabase::builtin().get("gypsum_bord", "house.yaml: assign.Wall*")); });
  EXPECT_THAT(message, AllOf(HasSubstr("house.yaml: assign.Wall*"), HasSubstr("gypsum_bord"), HasSubstr("'gypsum_board'")));
}

TEST(MaterialDatabase, RefusesWhatIsWrongInOneLine) {
  const std::string good = R"("absorption": [125, 0.2], "scattering": [125, 0.1])";
  ASSERT_EQ(error_of(with_entry(good)), "");
  const std::vector<std::pair<std::string, std::string>> wrong{
      {R"({"materials": [{"name": "felt" "labels": []}]})", "byte"},
      {"", "byte"},
      {"[]", "materials"},
      {R"({"materials": {}})", "materials"},
      {R"({"materials": [], "extra": 1})", "extra"},
      {R"({"materials": [7]})", "material 0"},
      {R"({"materials": [{"absorption": [125, 0.2], "scattering": [125, 0.1]}]})", "name"},
      {with_entry(R"("absorption": [125, 0.2])"), "scattering"},
      {with_entry(R"("scattering": [125, 0.2])"), "absorption"},
      {with_entry(R"("absorption": [125, 1.2], "scattering": [125, 0.1])"), "1.2"},
      {with_entry(R"("absorption": [125, -0.1], "scattering": [125, 0.1])"), "-0.1"},
      {with_entry(R"("absorption": [125, "much"], "scattering": [125, 0.1])"), "much"},
      {with_entry(R"("absorption": [125, null], "scattering": [125, 0.1])"), "null"},
      {with_entry(R"("absorption": [125, 1e999], "scattering": [125, 0.1])"), "range"},
      {with_entry(R"("absorption": [1e60, 0.1], "scattering": [125, 0.1])"), "large"},
      {with_entry(R"("absorption": [125], "scattering": [125, 0.1])"), "pairs"},
      {with_entry(R"("absorption": [], "scattering": [125, 0.1])"), "pairs"},
      {with_entry(R"("absorption": 0.2, "scattering": [125, 0.1])"), "pairs"},
      {with_entry(R"("absorption": [0, 0.2], "scattering": [125, 0.1])"), "0 Hz"},
      {with_entry(R"("absorption": [-125, 0.2], "scattering": [125, 0.1])"), "-125"},
      {with_entry(good + R"(, "absorbtion": [125, 0.2])"), "did you mean 'absorption'"},
      {with_entry(good + R"(, "labels": "wall")"), "labels"},
      {with_entry(good + R"(, "labels": [1])"), "labels"},
      {with_entry(good + R"(, "speed": "fast")"), "speed"},
      {with_entry(good + R"(, "density": -1)"), "density"},
      {with_entry(good + R"(, "damping": [125, -1])"), "damping"},
      {with_entry(good + R"(, "source": 3)"), "source"},
      {with_entry(good + R"(, "transmission": [125, 0.3])"), "transmission"},
      {R"({"materials": [{"name": "a", "absorption": [125, 0.2], "scattering": [125, 0.1]},
                         {"name": "a", "absorption": [125, 0.2], "scattering": [125, 0.1]}]})",
       "twice"},
  };
  for (const auto& [json, hint] : wrong) {
    const std::string message = error_of(json);
    EXPECT_THAT(message, AllOf(HasSubstr("db.json"), HasSubstr(hint), Not(HasSubstr("\n")))) << json;
  }
}

// Between their knots the curves are lines, so a transmission may exceed the absorption where neither has a knot in common.
TEST(MaterialDatabase, ComparesTransmissionAtTheKnotsOfBothCurves) {
  const std::string crossing =
      with_entry(R"("absorption": [100, 0.1, 1000, 0.1, 10000, 0.9], "scattering": [125, 0], "transmission": [100, 0, 10000, 0.4])");
  EXPECT_THAT(error_of(crossing), HasSubstr("exceeds the absorption 0.1 at 1000 Hz"));
  std::vector<MaterialWarning> warnings;
  const MaterialDatabase lowered = MaterialDatabase::from_json(crossing, "db", &warnings);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_EQ(warnings[0].material, "felt");
  EXPECT_FLOAT_EQ(lowered.all()[0].transmission.at(1000), 0.1f);
  EXPECT_FLOAT_EQ(lowered.all()[0].transmission.at(10000), 0.4f);
}

TEST(MaterialDatabase, MissingFileIsAnInputError) { EXPECT_THROW(MaterialDatabase::from_file("no/such/file.json"), InputError); }

TEST(BuiltinMaterials, ArePhysicalSourcedAndDistinct) {
  const MaterialDatabase database = MaterialDatabase::builtin();
  EXPECT_GE(database.all().size(), 40u);
  std::set<std::string> labels;
  for (const Material& material : database.all()) {
    EXPECT_FALSE(material.source.empty()) << material.name;
    for (float hz = 20; hz < 20000; hz *= 1.05f) {
      const float a = material.absorption.at(hz), s = material.scattering.at(hz), t = material.transmission.at(hz);
      ASSERT_TRUE(a >= 0 && a <= 1 && s >= 0 && s <= 1 && t >= 0 && t <= a + 1e-6f) << material.name << " at " << hz;
    }
    for (const std::string& label : material.labels) EXPECT_TRUE(labels.insert(label).second) << label << " is on two materials";
  }
  for (const char* label :
       {"default", "wall", "floor", "ceiling", "table", "chair",   "sofa",         "bed",    "cabinet", "door", "window",
        "curtain", "rug",  "plant", "tv",      "shelf", "counter", "refrigerator", "toilet", "bathtub", "sink", "stairs"}) {
    EXPECT_TRUE(labels.contains(label)) << label;
  }
}

// The published rows that the table must carry: Vorlaender 2008 (8 kHz included), and a transmission loss of 29 dB.
TEST(BuiltinMaterials, CarryThePublishedNumbers) {
  const MaterialDatabase database = MaterialDatabase::builtin();
  EXPECT_FLOAT_EQ(database.get("ceramic_tiles", "").absorption.at(500), 0.01f);
  EXPECT_FLOAT_EQ(database.get("curtain_heavy", "").absorption.at(8000), 0.71f);
  EXPECT_FLOAT_EQ(database.get("upholstery", "").absorption.at(1000), 0.89f);
  EXPECT_NEAR(10 * std::log10(database.get("wood_door", "").transmission.at(125)), -29, 0.05);
  EXPECT_EQ(database.find_label("default")->name, "default");
}

// Every row that is said to be Vorlaender's is the row of that name in the published file, number by number.
TEST(BuiltinMaterials, AreThePublishedRowsTheyName) {
  SKIP_WITHOUT_DATA("materials/pyroomacoustics_materials.json");
  const std::filesystem::path path = data_folder() / "materials/pyroomacoustics_materials.json";
  const nlohmann::json table = parse_json(read_file(path));
  const auto row = [&](const char* kind, const std::string& key) {
    for (const auto& group : table[kind]) {
      if (group.contains(key)) return group[key]["coeffs"].get<std::vector<float>>();
    }
    return std::vector<float>{};
  };
  const std::string mark = "Vorlaender, Auralization (Springer 2008), annex, row '";
  int compared = 0;
  const MaterialDatabase database = MaterialDatabase::builtin();
  for (const Material& material : database.all()) {
    for (const auto& [kind, curve] : {std::pair{"absorption", &material.absorption}, std::pair{"scattering", &material.scattering}}) {
      const std::string& source = material.source_of(kind);
      const std::size_t at = source.find(mark);
      if (at == std::string::npos) continue;
      const std::size_t begin = at + mark.size();
      EXPECT_EQ(curve->value, row(kind, source.substr(begin, source.find('\'', begin) - begin))) << material.name << " " << kind;
      EXPECT_EQ(curve->hz.front(), 125.f);
      ++compared;
    }
  }
  EXPECT_GE(compared, 35);
}

/// Absorption at random incidence of a locally reacting plane of this impedance over that of air (Kuttruff, Room Acoustics, eq. 2.42:
/// Paris' integral in closed form).
double random_incidence(std::complex<double> impedance) {
  const double size = std::abs(impedance), angle = std::arg(impedance), cosine = std::cos(angle), sine = std::sin(angle);
  const double turned = std::cos(2 * angle) / sine * std::atan2(size * sine, 1 + size * cosine);
  return 8 / (size * size) * cosine * (size + turned - cosine * std::log(1 + 2 * size * cosine + size * size));
}

// Ground by Delany and Bazley with the flow resistivity that its row names, kPa s/m2.  The table has three decimals.
TEST(BuiltinMaterials, GroundFollowsItsFlowResistivity) {
  const MaterialDatabase database = MaterialDatabase::builtin();
  for (const auto& [name, resistivity] : {std::pair{"soil", 200.0}, {"gravel", 500.0}, {"snow", 12.5}}) {
    const Material& material = database.get(name, "");
    EXPECT_THAT(material.source_of("absorption"), HasSubstr(fmt::format("flow resistivity {} kPa s/m2", resistivity)));
    for (const float hz : {125.f, 250.f, 500.f, 1000.f, 2000.f, 4000.f}) {
      const double ratio = static_cast<double>(hz) / resistivity;
      const std::complex<double> impedance(1 + 9.08 * std::pow(ratio, -0.75), 11.9 * std::pow(ratio, -0.73));
      EXPECT_NEAR(static_cast<double>(material.absorption.at(hz)), random_incidence(impedance), 0.0006) << name << ' ' << hz;
    }
  }
  EXPECT_EQ(database.find_label("dirt")->name, "soil");
}

TEST(BuiltinMaterials, AreTheTableInTheDocuments) {
  const std::string text = read_file(source_dir() / "docs/reference/materials.md");
  const MaterialDatabase database = MaterialDatabase::builtin();
  for (const Material& material : database.all()) {
    const std::pair<const char*, const CoefficientCurve*> rows[] = {
        {"absorption", &material.absorption}, {"scattering", &material.scattering}, {"transmission", &material.transmission}};
    for (const auto& [key, curve] : rows) {
      std::string line = fmt::format("| {} | {} |", key[0] == 'a' ? material.name : "", key[0]);
      for (const float hz : {125.f, 250.f, 500.f, 1000.f, 2000.f, 4000.f}) line += fmt::format(" {:.3g} |", curve->at(hz));
      line += " " + material.source_of(key) + " |\n";
      EXPECT_NE(text.find(line), std::string::npos) << "docs/reference/materials.md lacks the line " << line;
    }
  }
}

TEST(BuiltinMaterials, AreTheFileInConfigs) {
  const MaterialDatabase builtin = MaterialDatabase::builtin(), file = MaterialDatabase::from_file(source_dir() / "configs/materials.json");
  ASSERT_EQ(builtin.all().size(), file.all().size());
  for (std::size_t i = 0; i < file.all().size(); ++i) {
    EXPECT_EQ(builtin.all()[i].name, file.all()[i].name);
    EXPECT_EQ(builtin.all()[i].source, file.all()[i].source) << "the text goes through CMake: ; and @ must survive";
    EXPECT_EQ(builtin.all()[i].absorption.value, file.all()[i].absorption.value);
  }
}

TEST(MaterialKeys, AbsorptionIsDeclaredAsOptional) {
  EXPECT_FALSE(material_entry_key("absorption").is_required);  // an impedance stands for it
  EXPECT_TRUE(material_entry_key("scattering").is_required);
  EXPECT_NE(material_entry_key("absorption").about.find("unless impedance"), std::string::npos);
}

}  // namespace
}  // namespace earshot
