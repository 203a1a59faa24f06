// SPDX-License-Identifier: Apache-2.0
// Private sets: whatever names a set binds its content, and reading it ends.
#include "evaluation/leaderboard/private_set.h"

#include "evaluation/results/set_digest.h"
#include "fuzz/fuzz_target.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  static const fuzz::InputFile file("set.json");
  fuzz::expect_value_or_refusal([&] {
    const std::filesystem::path& path = file.write(fuzz::text_of(data, size));
    Benchmark benchmark;
    benchmark.name = "fuzzed";
    benchmark.private_sha256 = digest_of_set(path, file.folder().string(), file.folder().string());
    const Benchmark with = with_private_set(benchmark, path);
    if (with.set_hash != hex64(load_episode_set(path).hash)) fuzz::report("another set than the one that was named", with.set_hash);
  });
  return 0;
}
