// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <string>
#include <vector>

#include "apps/reference/config_reference.h"

namespace earshot {

/// A section as a page shows it, with what it repeats of a section that was shown before.
struct ShownSection {
  KeyGroup group;
  std::string place;                   ///< of the repeated section, "env.acoustics of a run config"; empty: it repeats none
  std::string anchor;                  ///< of that section, for links
  bool has_repeated_sections = false;  ///< the sections below are those of the repeated one, and are not shown
  std::vector<std::string> left_out;   ///< keys of the repeated section that this one does not have
  std::vector<ConfigKey> redefined;    ///< keys whose default differs
  std::vector<ConfigKey> own;          ///< keys that the repeated section does not have; all keys where nothing is repeated
};

/// Remembers the sections that were shown.
class ShownSections {
 public:
  /// The sections of a kind without those that repeat a section within a section that is repeated itself.  A repetition is of at least
  /// three keys and half of the section that is named.
  std::vector<ShownSection> show(const ConfigKind& kind);

 private:
  struct Shown {
    std::string kind, section, anchor;
    std::vector<ConfigKey> keys;
  };
  /// The shown section that has most keys of the group; none if it has too few.
  [[nodiscard]] const Shown* find_repeated(const KeyGroup& group) const;
  [[nodiscard]] const Shown* find(const std::string& kind, const std::string& section) const;

  std::deque<Shown> shown_;  ///< keeps addresses
};

/// Heading of a section as an address: "run-config-env-acoustics".
std::string anchor_of(const ConfigKind& kind, const std::string& section);

}  // namespace earshot
