// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "datasets/corpus_sounds.h"

namespace earshot {

/// A text as a manifest has it: without a byte-order mark, lines end with a line feed, and no blank or line end at either end.
std::string clean_transcript(std::string text);

/// Texts of the files of a folder of speech.  Of NAME.wav it is, in this order, NAME.txt, NAME.TXT, and the line that begins with NAME of a
/// *.trans.txt in the same folder (LibriSpeech: "NAME words").  Immutable, safe from any thread.
class Transcripts {
 public:
  /// Reads all.  Throws InputError naming file and line: a *.trans.txt that is not UTF-8, or that has two texts for one name.
  explicit Transcripts(const SoundFolder& speech);

  /// file: of SoundFolder::files.  Nothing: without a text.
  [[nodiscard]] std::optional<std::string> of(const std::string& file) const;
  /// Files whose text cannot be read, with the reason (not UTF-8, longer than 64 KiB, a folder).
  [[nodiscard]] const std::map<std::string, std::string>& unreadable() const { return unreadable_; }
  /// Lines of *.trans.txt without a sound file of their name.
  [[nodiscard]] std::size_t unused_lines() const { return unused_lines_; }
  /// Of the texts of `speech`, so that a corpus is not completed with others.
  [[nodiscard]] std::uint64_t hash(const SoundFolder& speech) const;

 private:
  std::map<std::string, std::string> texts_, unreadable_;  ///< by file
  std::size_t unused_lines_ = 0;
};

}  // namespace earshot
