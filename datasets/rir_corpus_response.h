// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "datasets/corpus_folder.h"
#include "datasets/rir_corpus_room.h"
#include "sim/acoustics/paths/early_reflections.h"
#include "sim/acoustics/response/place_check.h"
#include "sim/acoustics/source_field/source_field.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/sofa/sofa_room_responses.h"

namespace earshot {

/// Tables of the channels, for each head that listeners may have: config.hrtfs, or the one.
std::vector<std::shared_ptr<const SynthesisTables>> corpus_tables(const RirCorpusConfig& config);

/// Responses of one source of one room.  Not thread-safe; holds the source's field.
class CorpusSourceRenderer {
 public:
  /// All must outlive this.  heads: a synthesizer for each of config.hrtfs, or one.  The late sound is gathered from
  /// field_for_poses(config.listeners_per_source).
  CorpusSourceRenderer(const RirCorpusConfig& config, const CorpusRoom& room, std::size_t room_index, int source,
                       std::span<RirSynthesizer> heads);
  /// Renders a listener, appends its files, and returns its line of the manifest, without the line feed.  folder: prefix of the names
  /// there.  With config.sofa nothing is appended, and the response kept for sofa().
  /// Throws InputError where the listener cannot hear the source because one of them lies outside the closed room (place_check.h).
  std::string render(int listener, const std::string& folder, std::vector<CorpusFile>& files);
  /// All responses so far, for one file.
  [[nodiscard]] const SofaRoomResponses& sofa() const { return sofa_; }
  [[nodiscard]] std::string sofa_name() const;

 private:
  struct Recording;  // of the response at one listener: its names, its files and its line of the manifest

  /// Draws the place of a listener, again where the config asks for it (inputs/wished_rooms.h), and computes response_ there.
  CorpusListener hear(int listener);
  /// Appends the samples to the files, or to sofa_; returns the name of their file.
  std::string store(Recording& recording, const std::string& suffix, std::span<const float> channels);
  void label_geometry(Recording& recording) const;
  void add_pictures(Recording& recording) const;
  /// Stores the sound until config.split_ms after the direct sound, which stays in `samples`, and the sound from then on.
  void store_split(Recording& recording, std::vector<float>& samples);

  const RirCorpusConfig& config_;
  const CorpusRoom& room_;
  std::size_t room_index_;
  int number_;
  std::span<RirSynthesizer> heads_;
  CorpusSource source_;
  EarlyCandidates candidates_;
  PlaceCheck places_;
  std::shared_ptr<const SourceField> field_;
  EnergyResponse response_;
  Rir rir_;
  SofaRoomResponses sofa_;
};

}  // namespace earshot
