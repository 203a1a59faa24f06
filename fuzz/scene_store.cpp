// SPDX-License-Identifier: Apache-2.0
// What lies in the folder of preprocessed scenes behind headers whose sizes and hashes are right: a scene, its acoustics, a navmesh.
#include "fuzz/fuzz_target.h"
#include "sim/acoustics/model/acoustic_image.h"
#include "sim/nav/navmesh_image.h"
#include "sim/scene/scene_image.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  static const auto room = std::make_shared<const Scene>(load_scene("shoebox:6x3x4@0.2"));
  static const AcousticConfig config = [] {
    AcousticConfig c;
    c.rir_length_s = 0.1f;
    c.field = Switch::off;
    return c;
  }();
  std::string_view bytes = fuzz::text_of(data, size);
  const unsigned choice = fuzz::take_choice(bytes, 3);
  fuzz::expect_value_or_refusal([&] {
    if (choice == 0) {
      const Scene scene = decode_scene(bytes, "scene");
      for (const float x : {0.1f, 1.f, 3.f}) {
        const Hit hit = scene.rays().intersect({x, 1, 1}, {0, -1, 0});
        if (hit.valid() && hit.triangle >= scene.mesh().triangles.size()) fuzz::report("a hit on a triangle that is not there", "");
      }
      static_cast<void>(scene.bytes());
    } else if (choice == 1) {
      const AcousticScene acoustics = decode_acoustics(bytes, room, config, "acoustics");
      for (const std::uint32_t plane : acoustics.plane_of_triangle())
        if (plane >= acoustics.planes().size()) fuzz::report("a plane that is not there", "");
    } else {
      const Navmesh navmesh = decode_navmesh(bytes, {}, "navmesh");
      const glm::vec3 point = navmesh.random_point(RandomStream(1, Purpose::test), 0);
      static_cast<void>(navmesh.snap(point));
      static_cast<void>(navmesh.path_length_m({1, 0, 1}, point));
    }
  });
  return 0;
}
