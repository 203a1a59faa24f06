// SPDX-License-Identifier: Apache-2.0
// Sweep files.
#include "evaluation/leaderboard/sweep.h"

#include "fuzz/fuzz_target.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  static const fuzz::InputFile file("sweep.yaml");
  fuzz::expect_value_or_refusal([&] {
    const SweepConfig sweep = load_sweep(file.write(fuzz::text_of(data, size)));
    if (sweep.seeds.size() * sweep.runs.size() > 1000) return;
    static_cast<void>(runs_of(sweep));
  });
  return 0;
}
