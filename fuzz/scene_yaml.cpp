// SPDX-License-Identifier: Apache-2.0
// Scene YAML.
#include "fuzz/fuzz_target.h"
#include "sim/scene/scene_config.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  static const fuzz::InputFile file("scene.yaml");
  fuzz::expect_value_or_refusal([&] { read_scene_config(file.write(fuzz::text_of(data, size))); });
  return 0;
}
