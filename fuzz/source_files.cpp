// SPDX-License-Identifier: Apache-2.0
// Directivities of sources: CLF text, and pressures as the process that reads SOFA files sends them; responses of rooms as it sends them.
#include <cmath>

#include "fuzz/fuzz_target.h"
#include "sim/audio/head/measured_directivity.h"
#include "sim/audio/measured/room_responses.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  constexpr std::size_t few = 24;  // directions: kriging of many takes a second
  std::string_view text = fuzz::text_of(data, size);
  const unsigned choice = fuzz::take_choice(text, 3);
  const auto check = [](const Directivity& pattern) {
    for (const glm::vec3 direction : {glm::vec3(0, 0, -1), glm::vec3(0, 1, 0), glm::vec3(0.6f, -0.8f, 0)})
      for (const float frequency_hz : {63.f, 1000.f, 16000.f})
        if (!std::isfinite(pattern.pressure(direction, frequency_hz))) fuzz::report("a gain that is not finite", "");
  };
  fuzz::expect_value_or_refusal([&] {
    if (choice == 0) {
      check(*clf_directivity_from_text(text, "speaker.tab"));
    } else if (choice == 2) {
      const RoomResponses room = decode_room(text, "room.sofa");
      if (decode_room(encode_room(room), "again").samples.size() != room.samples.size()) fuzz::report("the way back differs", "");
    } else {
      const MeasuredSource source = decode_source(text, "speaker.sofa");
      if (decode_source(encode_source(source), "again").pressure.size() != source.pressure.size()) fuzz::report("the way back differs", "");
      if (source.direction.size() <= few) check(*measured_directivity(source, "speaker.sofa"));
    }
  });
  return 0;
}
