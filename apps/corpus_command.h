#pragma once

#include <cstddef>
#include <functional>
#include <string>

#include "envs/rir_corpus.h"

namespace earshot {

/// Where a command of `earshot dataset` writes a corpus, and with what.
struct CorpusTarget {
  std::string out, shard = "1/1";
  int threads = 0;
};

/// Calls write with the run that the target asks for and shows its progress, in `unit`s, under the command's name.  Returns the seconds
/// that it took.  Throws InputError naming --shard, and what write throws.
double write_with_progress(const CorpusTarget& target, const std::string& command, const std::string& unit,
                           const std::function<void(const CorpusRun& run)>& write);

void print_missing_folders(const CorpusTarget& target, std::size_t count);

}  // namespace earshot
