// SPDX-License-Identifier: Apache-2.0
// Result files and the leaderboard that is made of them.
#include "evaluation/results/result.h"

#include "evaluation/leaderboard/board_entry.h"
#include "evaluation/leaderboard/leaderboard.h"
#include "evaluation/leaderboard/leaderboard_page.h"
#include "fuzz/fuzz_target.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  static const fuzz::InputFile file("result.json");
  fuzz::expect_value_or_refusal([&] {
    const EvaluationResult result = load_result(file.write(fuzz::text_of(data, size)));
    EvaluationResult other = result;
    other.agent += "2";
    const std::vector<EvaluationResult> table = ranked({result, other});
    static_cast<void>(leaderboard_text(table));
    static_cast<void>(leaderboard_page(table, {}));
    static const Benchmark benchmark;
    static_cast<void>(standing_of(result, "result.json", benchmark));
  });
  return 0;
}
