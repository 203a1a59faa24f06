// SPDX-License-Identifier: Apache-2.0
// Pictures of meshes through texture.h: PNG and JPEG, and coordinates of any size.
#include "sim/scene/texture.h"

#include "fuzz/fuzz_target.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  const std::string_view bytes = fuzz::text_of(data, size);
  fuzz::expect_value_or_refusal([&] {
    const Texture texture = decode_texture(bytes, "texture.png", 64);
    if (texture.rgb.size() != 3 * static_cast<std::size_t>(texture.width_px) * static_cast<std::size_t>(texture.height_px))
      fuzz::report("a picture of another size", "");
    for (const float u : {-1e30f, -0.5f, 0.f, 1.f, 7.3f, 1e30f}) {
      const glm::vec3 color = sample_bilinear(texture, {u, 1.f - u});
      if (!(color.x >= 0 && color.x <= 1 && color.y >= 0 && color.y <= 1 && color.z >= 0 && color.z <= 1))
        fuzz::report("a colour out of range", "");
    }
  });
  return 0;
}
