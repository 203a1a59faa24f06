#pragma once

#include <memory>
#include <string>
#include <vector>

#include "envs/rir_corpus_room.h"
#include "sim/acoustics/paths/early_reflections.h"
#include "sim/acoustics/source_field/source_field.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"

namespace earshot {

/// Names of the channels of a layout: left and right, harmonics by ACN number, names of microphones.
std::vector<std::string> channel_names(const ListenerLayout& layout);

/// A file of a response and its bytes.
struct CorpusFile {
  std::string name;  ///< within the folder of the room
  std::string bytes;
};

/// Responses of one source of one room.  Not thread-safe; holds the source's field.
class CorpusSourceRenderer {
 public:
  /// All must outlive this.  A field is built where the plan of the scene calls for one, from 300 listeners on or with field = on.
  CorpusSourceRenderer(const RirCorpusConfig& config, const CorpusRoom& room, std::size_t room_index, int source,
                       RirSynthesizer& synthesizer);
  /// Renders a listener, appends its files, and returns its line of the manifest, without the line feed.  folder: prefix of the names
  /// there.
  std::string render(int listener, const std::string& folder, std::vector<CorpusFile>& files);

 private:
  const RirCorpusConfig& config_;
  const CorpusRoom& room_;
  std::size_t room_index_;
  int number_;
  RirSynthesizer& synthesizer_;
  CorpusSource source_;
  EarlyCandidates candidates_;
  std::shared_ptr<const SourceField> field_;
  EnergyResponse response_;
  Rir rir_;
};

}  // namespace earshot
