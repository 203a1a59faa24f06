// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <cstddef>
#include <functional>
#include <string>

#include "datasets/rir_corpus.h"

namespace earshot {

/// Where a command of `earshot dataset` writes a corpus, and with what.
struct CorpusTarget {
  std::string out, shard = "1/1";
  int threads = 0;
};

/// --out, and further down in what --help says, --threads and --shard.  `parts`: unit that shards divide.
void add_out_option(CLI::App& command, CorpusTarget& target);
void add_sharing_options(CLI::App& command, CorpusTarget& target, const std::string& parts = "for N machines");

/// Calls write with the run that the target asks for and shows its progress, in `unit`s, under the command's name.  Returns the seconds
/// that it took.  Throws InputError naming --shard, and what write throws.
double write_with_progress(const CorpusTarget& target, const std::string& command, const std::string& unit,
                           const std::function<void(const CorpusRun& run)>& write);

/// Prints the content of a complete corpus, or the number of folders that other shards have yet to write.
void print_state(const CorpusTarget& target, std::size_t folders_missing, const std::string& complete);

/// What --help says of --skip-bad.
inline constexpr const char* kSkipBadHelp =
    "Leave out sound files that cannot be decoded, are silent or have an unreadable text, and list them in inputs.jsonl. Without this "
    "option, a bad file ends the command before anything is written";
/// Prints the number of files that --skip-bad has left out, if any.
void print_left_out(const CorpusTarget& target, std::size_t left_out);

}  // namespace earshot
