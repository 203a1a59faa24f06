// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "sim/audio/dry_sounds/sound_clip.h"

namespace earshot {

/// A response of a corpus of `earshot dataset rir`, as its manifest has it.
struct IndexedResponse {
  std::string id, file, early_file;  ///< paths within the corpus; early_file is empty where the corpus has no split
  std::size_t room = 0;
  int source = 0;
  std::string place;  ///< of the listener: equal texts are one place and orientation
  double distance_m = 0, direct_delay_s = 0, gain = 1;
  double t20_mid_s = 0, drr_db = 0;  ///< not a number where the manifest has null
  std::string labels;                ///< JSON: further properties of the signal, such as directions
};

/// The responses of a complete corpus, or of a folder of measured ones.  Immutable, safe from any thread.
class ResponseIndex {
 public:
  /// Throws InputError: no corpus, one that is not complete, damaged, or without sound files.
  explicit ResponseIndex(std::filesystem::path corpus);
  /// Of measured responses (measured_index.h).  Throws InputError as index_measured, and for a corpus.
  static ResponseIndex of_measured(std::filesystem::path folder);

  [[nodiscard]] const std::vector<IndexedResponse>& responses() const { return responses_; }
  /// Indices of the responses of the room of `response`.
  [[nodiscard]] const std::vector<std::size_t>& room_of(std::size_t response) const;
  /// Number of sources in the room that has fewest.
  [[nodiscard]] std::size_t fewest_sources() const;
  [[nodiscard]] bool has_early() const;
  [[nodiscard]] float sample_rate_hz() const { return sample_rate_hz_; }
  [[nodiscard]] const std::vector<std::string>& channels() const { return channels_; }
  /// Of the manifest: the same corpus.
  [[nodiscard]] std::uint64_t hash() const { return hash_; }
  /// [channels, samples] in pressure per unit source.  file: of IndexedResponse.  Throws InputError.
  [[nodiscard]] SoundChannels load(const IndexedResponse& response, const std::string& file) const;

 private:
  ResponseIndex() = default;
  /// Fills rooms_.
  void sort_into_rooms();

  std::filesystem::path corpus_;
  float sample_rate_hz_ = 0;
  std::vector<std::string> channels_;
  std::uint64_t hash_ = 0;
  std::vector<IndexedResponse> responses_;
  std::vector<std::vector<std::size_t>> rooms_;
};

}  // namespace earshot
