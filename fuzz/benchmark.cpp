// SPDX-License-Identifier: Apache-2.0
// Benchmark files.
#include "evaluation/leaderboard/benchmark.h"

#include "fuzz/fuzz_target.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  static const fuzz::InputFile file("benchmark.yaml");
  fuzz::expect_value_or_refusal([&] { static_cast<void>(load_benchmark(file.write(fuzz::text_of(data, size)))); });
  return 0;
}
