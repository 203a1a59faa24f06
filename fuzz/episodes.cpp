// SPDX-License-Identifier: Apache-2.0
// Episode sets, JSON or gzipped JSON.
#include "envs/episodes/episode_set.h"
#include "envs/episodes/gzip.h"
#include "fuzz/fuzz_target.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  std::string_view bytes = fuzz::text_of(data, size);
  const unsigned choice = fuzz::take_choice(bytes, 2);
  fuzz::expect_value_or_refusal([&] {
    const EpisodeSet set = parse_episode_set(choice == 0 ? std::string(bytes) : gzip(bytes), "set.json.gz");
    if (episode_set_hash(set.episodes) != set.hash) fuzz::report("the hash of a set is not that of its episodes", "");
  });
  if (choice == 1 || !is_gzip(bytes)) return 0;
  fuzz::expect_value_or_refusal([&] { gunzip(bytes, "set.json.gz", 1 << 20); });
  return 0;
}
