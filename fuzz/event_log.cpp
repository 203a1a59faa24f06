// SPDX-License-Identifier: Apache-2.0
// The event log that a resumed run reads.
#include "trainer/curves/event_log.h"

#include "fuzz/fuzz_target.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  static const fuzz::InputFile file("events.jsonl");
  fuzz::expect_value_or_refusal([&] { read_event_log(file.write(fuzz::text_of(data, size))); });
  return 0;
}
