// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "datasets/corpus_sounds.h"

namespace earshot {

/// A sound file that a corpus may read.
struct InputFile {
  std::string group;  ///< speech, noise, or the name of a class
  std::string name;   ///< as manifests have it: within its folder
  std::filesystem::path path;
  std::string reason = {};  ///< not empty: bad for another cause than its sound
};

struct InputRules {
  bool skip_bad = false;  ///< bad files are left out; else they are refused
  float sample_rate_hz = 16000;
  int threads = 0;  ///< 0: all cores
  /// Called from the caller's thread with the files opened so far and in all.
  std::function<void(std::uint64_t opened, std::uint64_t total)> progress = {};
};

/// Which sound files a corpus uses.  A file is bad if it cannot be decoded to its end (load_sound), if it is silent, if its name is not
/// UTF-8 (as manifests are), or for the reason that comes with it.  The record lies in the folder of the corpus as inputs.jsonl: a line of
/// {group, file, bytes, left_out} for each, left_out null or the reason.  Files of a record that kept their size are not opened again, so
/// that a completed run starts at once.
class CorpusInputs {
 public:
  /// Opens all files, on several threads.  Writes nothing.  Throws InputError that names the bad files, up to ten of them, without
  /// skip_bad.
  CorpusInputs(std::vector<InputFile> files, const std::filesystem::path& corpus, const InputRules& rules);

  /// The files of a group that are good, in their order.
  [[nodiscard]] std::vector<std::string> good(const std::string& group) const;
  /// Files that are left out, of those that are there.
  [[nodiscard]] std::size_t left_out() const;
  /// Writes the record unless there is no file, or the corpus has a record: it stays true where a bad file has been removed since.
  void record() const;

 private:
  struct Checked {
    std::uint64_t bytes = 0;
    std::string reason;
  };
  std::vector<InputFile> files_;
  std::vector<Checked> checked_;  ///< for each of them
  std::filesystem::path record_path_;
};

/// Throws InputError if a corpus in `out` would lie in `folder`, which is read with all that lies below it, also by way of links.  name: of
/// the option or key that gives the folder.
void require_outside(const std::filesystem::path& out, const std::filesystem::path& folder, const std::string& name);

}  // namespace earshot
