// SPDX-License-Identifier: Apache-2.0
// Scenes of one triangle and of none, material tables with odd entries, and text as other systems write it (docs/evidence/stability.md,
// H-24 to H-28, H-70, H-72).

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <clocale>
#include <cstdlib>
#include <glm/geometric.hpp>
#include <locale>

#include "envs/episodes/episode_set.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/source_field/source_field_store.h"
#include "sim/base/errors.h"
#include "sim/scene/generators/shoebox.h"
#include "sim/scene/scene_report.h"
#include "tests/support/files/cloud_files.h"
#include "tests/support/files/mesh_cases.h"

namespace earshot {
namespace {

using namespace mesh_cases;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

TEST(H24_OneTriangle, LoadsAndIsOpen) {
  const TempFolder folder;
  const Scene scene = load_scene(folder.write("one.obj", "v -1 0 -1\nv 1 0 -1\nv 0 0 2\nf 1 2 3\n"));
  EXPECT_EQ(scene.rays().num_triangles(), 1u);
  const SceneReport report = report_scene(scene);
  EXPECT_EQ(report.open_edges, 3u);
  // From the air above a floor, at least the upper half of the directions leaves.
  EXPECT_GE(report.leaked_ray_fraction, 0.5);
  EXPECT_THAT(scene.import_report().warnings, IsEmpty());
}

TEST(H25_NoTriangle, AFileWithoutTrianglesIsRefusedAnEmptySceneIsFreeField) {
  for (const auto& [name, bytes] : {std::pair{"a.obj", "# nothing\n"},
                                    {"b.stl", "solid x\nendsolid x\n"},
                                    {"c.obj", "v 0 0 0\nv 1 0 0\nl 1 2\n"},
                                    {"d.ply", "ply\nformat ascii 1.0\nend_header\n"}})
    EXPECT_THAT(message_of<InputError>([&, &name = name, &bytes = bytes] { import(name, bytes); }), HasSubstr(name));
  AcousticConfig config;
  config.bands = 1;
  config.air_absorption = Switch::off;
  const AcousticScene acoustics(std::make_shared<const Scene>("empty", TriangleMesh{}, std::vector<Material>{}, Air{}), config);
  EnergyResponse response;
  compute_energy_response(acoustics, EarlyCandidates(acoustics, glm::vec3(1, 2, 3)), {4, 6, 3}, response);
  ASSERT_THAT(response.arrivals, SizeIs(1));
  EXPECT_FLOAT_EQ(response.arrivals[0].distance_m, 5);
  EXPECT_FLOAT_EQ(response.arrivals[0].amplitude[0], static_cast<float>(1 / (4 * 3.14159265358979 * 5)));
  for (const float value : response.late.values()) EXPECT_EQ(value, 0.f);
}

MaterialDatabase one_material(const std::string& curves, std::vector<MaterialWarning>* warnings = nullptr) {
  return MaterialDatabase::from_json(R"({"materials": [{"name": "felt", )" + curves + "}]}", "db.json", warnings);
}

// Text of numbers outside [0, 1]: MaterialDatabase.RefusesWhatIsWrongInOneLine.  Values that come in through memory are the caller's.
TEST(H26_CoefficientOutsideItsRange, IsRefusedByTheKeyAndTheValue) {
  for (const char* key : {"absorption", "scattering", "transmission"}) {
    for (const char* value : {"1.0001", "-1e-9", "2", "1e30"}) {
      std::string curves = R"("absorption": [125, 1], "scattering": [125, 0.1], "transmission": [125, 0])";
      const std::size_t at = curves.find(std::string("\"") + key), open = curves.find(',', at), close = curves.find(']', at);
      curves.replace(open + 2, close - open - 2, value);
      EXPECT_THAT(message_of<InputError>([&] { one_material(curves); }), testing::AllOf(HasSubstr(key), HasSubstr("outside [0, 1]")))
          << curves;
    }
    EXPECT_THAT(message_of<InputError>([] { one_material(R"("absorption": [125, NaN], "scattering": [125, 0.1])"); }),
                HasSubstr("not JSON"));
  }
  EXPECT_THROW(load_scene("shoebox:5x3x4@1.5"), InputError);
  EXPECT_THROW(load_scene("shoebox:5x3x4@nan"), InputError);
}

TEST(H27_TransmissionAboveAbsorption, IsRefusedOrLoweredAndReported) {
  const char* curves = R"("absorption": [125, 0.2, 4000, 0.6], "scattering": [125, 0.1], "transmission": [125, 0.5, 4000, 0.5])";
  EXPECT_THAT(message_of<InputError>([&] { one_material(curves); }), HasSubstr("0.5 exceeds the absorption 0.2 at 125 Hz"));
  std::vector<MaterialWarning> warnings;
  const MaterialDatabase database = one_material(curves, &warnings);
  ASSERT_THAT(warnings, SizeIs(1));
  EXPECT_THAT(warnings[0].text, HasSubstr("lowered to the absorption"));
  for (const float hz : {63.f, 125.f, 500.f, 4000.f, 8000.f})
    EXPECT_LE(database.find("felt")->transmission.at(hz), database.find("felt")->absorption.at(hz)) << hz;
  EXPECT_FLOAT_EQ(database.find("felt")->transmission.at(4000), 0.5f);
  // A scene accepts this table with a warning.
  const TempFolder folder;
  folder.write("room.obj", obj_text(box({5, 3, 4})));
  folder.write("db.json", R"({"materials": [{"name": "default", "labels": ["default"], )" + std::string(curves) + "}]}");
  const Scene scene = load_scene(folder.write("room.yaml", "mesh: room.obj\nmaterials: db.json\n"));
  EXPECT_THAT(scene.import_report().warnings, ElementsAre(HasSubstr("lowered")));
}

TEST(H28_OddFrequencies, AreSortedJoinedAndHeld) {
  const MaterialDatabase database =
      one_material(R"("absorption": [4000, 0.4, 125, 0.1, 1000, 0.9, 1000, 0.3, 125, 0.2], "scattering": [777, 0.25])");
  const Material& felt = *database.find("felt");
  EXPECT_THAT(felt.absorption.hz, ElementsAre(125, 1000, 4000));
  EXPECT_THAT(felt.absorption.value, ElementsAre(0.2f, 0.3f, 0.4f)) << "of equal ones the last";
  for (const float hz : {1.f, 777.f, 20000.f}) EXPECT_EQ(felt.scattering.at(hz), 0.25f) << "one point is a constant";
  EXPECT_EQ(felt.scattering.band_mean(88, 177), 0.25f);
  EXPECT_THAT(message_of<InputError>([] { one_material(R"("absorption": [], "scattering": [125, 0.1])"); }), HasSubstr("absorption"));
  EXPECT_THAT(message_of<InputError>([] { one_material(R"("absorption": [0, 0.2], "scattering": [125, 0.1])"); }), HasSubstr("0 Hz"));
}

/// A room with a door leaf that stands at x.
std::shared_ptr<const Scene> room_with_door(double x) {
  DoubleMesh mesh = box({5, 3, 4});
  const DoubleMesh door = box({0.05, 2, 0.8}, {x, 0, 1});
  for (const glm::dvec3 v : door.vertices) mesh.vertices.push_back(v);
  for (const glm::uvec3 t : door.triangles) mesh.triangles.push_back(t + glm::uvec3(8));
  return scene_of(mesh);
}

// Scenes do not change: a door that moved is another scene with another identity, and nothing that was kept for the first serves it.
TEST(H70_MovedDoor, IsAnotherSceneAndTakesNothingFromCaches) {
  AcousticConfig config;
  config.field = Switch::on;
  config.field_photons = 2048;
  config.bands = 1;
  const auto before = room_with_door(2), after = room_with_door(2.001);
  EXPECT_NE(before->hash(), after->hash()) << "a millimetre is a difference";
  const AcousticScene a(before, config), b(after, config), c(room_with_door(2), config);
  EXPECT_NE(a.hash(), b.hash());
  EXPECT_EQ(a.hash(), c.hash()) << "moved back, it is the first one again";
  SourceFieldStore store({});
  const EarlyCandidates of_a(a, glm::vec3(1, 1.5f, 1)), of_b(b, glm::vec3(1, 1.5f, 1)), of_c(c, glm::vec3(1, 1.5f, 1));
  const auto field = store.get(a, of_a);
  EXPECT_NE(store.get(b, of_b), field);
  EXPECT_EQ(store.get(c, of_c), field);
}

std::string with_crlf(std::string text) {
  for (std::size_t at = 0; (at = text.find('\n', at)) != std::string::npos; at += 2) text.replace(at, 1, "\r\n");
  return text;
}

const std::string kBom = "\xEF\xBB\xBF";

TEST(H72_ForeignText, LineEndsAndByteOrderMarks) {
  const DoubleMesh mesh = box({5.25, 3, 4.5});
  const std::uint64_t expected = hash_of(import("room.obj", obj_text(mesh)).mesh);
  for (const auto& [name, text] :
       {std::pair{"room.obj", obj_text(mesh)}, {"room.ply", ply_file(mesh, PlyBody::text)}, {"room.stl", stl_text(mesh)}}) {
    for (const std::string& bytes : {text, with_crlf(text), kBom + text, kBom + with_crlf(text), text.substr(0, text.size() - 1)}) {
      const ImportedMesh imported = import(name, bytes);
      EXPECT_EQ(imported.mesh.triangles.size(), 12u) << name;
      EXPECT_EQ(imported.mesh.vertices.size(), 8u) << name;
      EXPECT_EQ(bounds_of(imported.mesh).upper, glm::vec3(5.25f, 3, 4.5f)) << name;
      if (std::string_view(name) == "room.obj") {
        EXPECT_EQ(hash_of(imported.mesh), expected);
      }
    }
  }
  // The mark stands right before the first vertex: it must not cost that vertex.
  std::string obj = obj_text(mesh);
  obj.erase(0, obj.find("v "));
  EXPECT_EQ(import("room.obj", kBom + obj).mesh.vertices.size(), 8u);
  EXPECT_EQ(import("room.gltf", kBom + gltf_file(mesh)).mesh.triangles.size(), 12u);
}

TEST(H72_ForeignText, BinaryPlyInBothByteOrdersAndWithCrlfHeader) {
  const DoubleMesh mesh = box({5.25, 3, 4.5});
  for (const PlyBody body : {PlyBody::floats, PlyBody::floats_big_endian, PlyBody::doubles, PlyBody::doubles_big_endian}) {
    const std::string file = ply_file(mesh, body);
    const std::size_t end = file.find("end_header\n") + std::string_view("end_header\n").size();
    for (const std::string& bytes : {file, with_crlf(file.substr(0, end)) + file.substr(end)}) {
      const ImportedMesh imported = import("room.ply", bytes);
      EXPECT_EQ(imported.mesh.triangles.size(), 12u);
      EXPECT_EQ(bounds_of(imported.mesh).upper, glm::vec3(5.25f, 3, 4.5f));
    }
  }
}

TEST(H72_ForeignText, MaterialsScenesAndEpisodesWithMarksAndCrlf) {
  const TempFolder folder;
  folder.write("room.obj", obj_text(box({5, 3, 4})));
  const std::string materials =
      "{\"materials\": [\n{\"name\": \"default\", \"labels\": [\"default\"], \"absorption\": [125, 0.25], \"scattering\": [125, 0.5]}]}\n";
  const std::string yaml = "mesh: room.obj\nunit_m: 0.5\nceiling_m: 2.5\nmaterials: db.json\nair: {temperature_c: 21.5}\n";
  folder.write("db.json", materials);
  const std::uint64_t expected = load_scene(folder.write("plain.yaml", yaml)).hash();
  for (const auto& [m, y] : {std::pair{with_crlf(materials), with_crlf(yaml)}, {kBom + materials, kBom + yaml}}) {
    folder.write("db.json", m);
    EXPECT_EQ(load_scene(folder.write("s.yaml", y)).hash(), expected);
  }
  const std::string set = R"({"episodes":[{"episode_id":"0","scene_id":"a.glb","start_position":[1.5,0,-2],"start_rotation":[0,0,0,1],
"goals":[{"position":[4.25,0,1.5]}],"info":{"geodesic_distance":7.5,"num_action":11,"sound":"s"}}]})";
  EXPECT_EQ(parse_episode_set(kBom + with_crlf(set), "set").hash, parse_episode_set(set, "set").hash);
}

/// The C and C++ locales with a decimal comma for as long as it lives.  The C one is compiled into a folder of its own, if that is possible
/// here.
class DecimalComma {
 public:
  DecimalComma() : cpp_(std::locale::global(std::locale(std::locale::classic(), new Comma))) {
    const std::string path = folder_ / "de_DE.UTF-8";
    if (std::system(("localedef -i de_DE -f UTF-8 " + path + " >/dev/null 2>&1").c_str()) == 0) {
      ::setenv("LOCPATH", std::filesystem::path(path).parent_path().c_str(), 1);
      c_ = std::setlocale(LC_ALL, "de_DE.UTF-8") != nullptr;
      ::unsetenv("LOCPATH");
    }
  }
  ~DecimalComma() {
    std::setlocale(LC_ALL, "C");
    std::locale::global(cpp_);
  }
  DecimalComma(const DecimalComma&) = delete;
  DecimalComma& operator=(const DecimalComma&) = delete;
  [[nodiscard]] bool c_too() const { return c_; }

 private:
  struct Comma : std::numpunct<char> {
    char do_decimal_point() const override { return ','; }
    char do_thousands_sep() const override { return '.'; }
    std::string do_grouping() const override { return "\3"; }
  };
  TempFolder folder_;
  std::locale cpp_;
  bool c_ = false;
};

TEST(H72_ForeignText, DecimalCommaOfTheLocaleChangesNothing) {
  const TempFolder folder;
  const DoubleMesh mesh = box({5.25, 3.125, 1234.5});
  const std::vector<std::string> files{folder.write("a.obj", obj_text(mesh)), folder.write("a.ply", ply_file(mesh, PlyBody::text)),
                                       folder.write("a.stl", stl_text(mesh)),
                                       folder.write("far.obj", obj_text(box({5.25, 3.125, 4.5}, {123456.5, 0, 0}))),
                                       folder.write("a.gltf", gltf_file(mesh, {1.5, 2.25, -3.75}))};
  const std::string cloud = folder.write("a.xyz", xyz_points(sample_surface(make_shoebox({3, 2.5, 4}), 30'000, 0.002, 1)));
  const std::string database =
      R"({"materials": [{"name": "default", "absorption": [125.5, 0.25, 2000.5, 0.75], "scattering": [125, 0.5]}]})";
  const auto hashes = [&] {
    std::vector<std::uint64_t> all;
    for (const std::string& file : files) {
      const TriangleMesh imported = import_mesh(file).mesh;
      all.push_back(hash_of(imported));
      all.push_back(std::bit_cast<std::uint64_t>(imported.origin_m.x));
    }
    all.push_back(load_scene(cloud).hash());  // in cells of a default size
    for (const std::string spec : {"shoebox:5.5x3.25x1234.5@0.125", "house:2,area_m2=62.5"}) all.push_back(load_scene(spec).hash());
    const MaterialDatabase materials = MaterialDatabase::from_json(database, "db");
    for (const float hz : materials.all()[0].absorption.hz) all.push_back(std::bit_cast<std::uint32_t>(hz));
    return all;
  };
  const std::vector<std::uint64_t> expected = hashes();
  const DecimalComma comma;
  ASSERT_EQ(fmt::format("{}", 0.5), "0.5") << "what we write ourselves does not follow the locale either";
  EXPECT_EQ(hashes(), expected);
  if (!comma.c_too()) GTEST_LOG_(INFO) << "localedef is not here: the C locale was not changed";
}

}  // namespace
}  // namespace earshot
