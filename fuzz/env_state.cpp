// SPDX-License-Identifier: Apache-2.0
// The state of the environments inside a checkpoint: as it is, or behind a checksum that is right.
#include "envs/batch/env_state.h"

#include <nlohmann/json.hpp>

#include "fuzz/fuzz_target.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  std::string_view bytes = fuzz::text_of(data, size);
  const bool sanitize = fuzz::take_choice(bytes, 2) == 1;
  std::string text(bytes);
  if (sanitize) {
    const auto body = parse_json_or_discard(bytes);
    if (body.is_discarded()) return 0;
    const std::string dumped = json_text_of_any_bytes(body);
    text = R"({"earshot_env_state":1,"checksum":")" + hex64(hash64(dumped)) + R"(","body":)" + dumped + "}";
  }
  fuzz::expect_value_or_refusal([&] {
    const EnvState state = decode_env_state(text);
    if (decode_env_state(encode(state)).envs.size() != state.envs.size()) fuzz::report("the way back differs", "");
  });
  return 0;
}
