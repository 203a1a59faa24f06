// SPDX-License-Identifier: Apache-2.0
// A scene of Habitat, of which one JSON file is the input by the first byte: the data set's, the scene's, an object's or the classes.
#include "sim/scene/habitat/habitat_scene.h"

#include <fstream>

#include "fuzz/fuzz_target.h"
#include "sim/scene/habitat/habitat_import.h"

namespace {

constexpr const char* kNames[] = {"a.scene_dataset_config.json", "a.scene_instance.json", "a.object_config.json", "classes.json"};
constexpr const char* kTexts[] = {
    R"({"stages": {"paths": {".obj": ["."]}}, "objects": {"paths": {".json": ["."]}}, "scene_instances": {"paths": {".json": ["."]}},
        "semantic_scene_descriptor_instances": {"c": "classes.json"}})",
    R"({"stage_instance": {"template_name": "a.obj"}, "semantic_scene_instance": "c",
        "object_instances": [{"template_name": "a", "translation": [0, 2, 0], "rotation": [0, 1, 0, 0]}]})",
    R"({"render_asset": "a.obj", "semantic_id": 1, "up": [0, 0, 1], "front": [0, 1, 0]})", R"({"classes": [{"id": 1, "name": "sofa"}]})"};
constexpr std::string_view kMesh = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n";

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  static const fuzz::InputFile mesh("a.obj");
  static const bool is_written = !mesh.write(kMesh).empty();
  std::string_view text = fuzz::text_of(data, size);
  const unsigned choice = fuzz::take_choice(text, 4);
  for (unsigned i = 0; is_written && i < 4; ++i) std::ofstream(mesh.folder() / kNames[i]) << (i == choice ? text : kTexts[i]);
  fuzz::expect_value_or_refusal([&] {
    const TriangleMesh imported = import_habitat_scene((mesh.folder() / kNames[0]).string() + ",scene=a").mesh;
    for (const glm::uvec3 corners : imported.triangles)
      if (corners.x >= imported.vertices.size() || corners.y >= imported.vertices.size() || corners.z >= imported.vertices.size())
        fuzz::report("a triangle has no vertex", "");
  });
  return 0;
}
