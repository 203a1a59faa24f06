// SPDX-License-Identifier: Apache-2.0
// Directivity balloons and microphone arrays.
#include <cmath>

#include "fuzz/fuzz_target.h"
#include "sim/audio/head/directivity.h"
#include "sim/audio/head/listener_layout.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  static const fuzz::InputFile file("array.yaml");
  std::string_view text = fuzz::text_of(data, size);
  const unsigned choice = fuzz::take_choice(text, 2);
  fuzz::expect_value_or_refusal([&] {
    if (choice == 0) {
      const auto balloon = Directivity::balloon_from_text(text, "balloon.yaml");
      for (const glm::vec3 direction : {glm::vec3(0, 0, -1), glm::vec3(0, 1, 0), glm::vec3(0.6f, -0.8f, 0)})
        if (!std::isfinite(balloon->pressure(direction, 1000.f))) fuzz::report("a gain that is not finite", "");
    } else {
      static_cast<void>(ListenerLayout::from_file(file.write(text)).num_channels());
    }
  });
  return 0;
}
