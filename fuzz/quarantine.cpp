// SPDX-License-Identifier: Apache-2.0
// Files of quarantined episodes, which `earshot replay` reads.
#include "envs/batch/quarantine.h"

#include "fuzz/fuzz_target.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  fuzz::expect_value_or_refusal([&] {
    const QuarantineRecord record = decode_quarantine_record(fuzz::text_of(data, size), "episode.json");
    const std::string text = encode(record);
    if (encode(decode_quarantine_record(text, "again")) != text) fuzz::report("the way back differs", text);
  });
  return 0;
}
