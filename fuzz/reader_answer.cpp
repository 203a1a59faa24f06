// SPDX-License-Identifier: Apache-2.0
// What a damaged reader process may send: the frame of the answer, then the responses of a head.
#include "fuzz/fuzz_target.h"
#include "sim/audio/head/sofa_reader.h"
#include "sim/base/process/isolated_call.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  std::string_view bytes = fuzz::text_of(data, size);
  const unsigned choice = fuzz::take_choice(bytes, 2);
  fuzz::expect_value_or_refusal([&] {
    if (choice == 0) {
      const Answer answer = decode_answer(bytes, 1 << 20);
      if (answer.state == Answer::State::whole && answer.bytes.size() > bytes.size())
        fuzz::report("the answer is longer than its frame", "");
    } else {
      const SofaResponses responses = decode_responses(bytes, "head.sofa");
      if (decode_responses(encode_responses(responses), "again").taps != responses.taps) fuzz::report("the way back differs", "");
    }
  });
  return 0;
}
