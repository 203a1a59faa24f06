// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "sim/base/text/config_key.h"

namespace earshot {

/// A kind of config file with all of its keys, sections among them, in the order of its reader.
struct ConfigKind {
  std::string name;   ///< "run config"
  std::string about;  ///< its purpose and the commands that read it
  std::vector<ConfigKey> keys;
};

/// Every kind of config that Earshot reads, described by the readers themselves.  About a millisecond.
std::vector<ConfigKind> config_reference();

/// Whether a key of the reference stands for `name`: a part in capitals is any name, "[]" any index.
bool stands_for(const ConfigKey& key, const std::string& name);
/// The keys of a section without those of the sections in it.
struct KeyGroup {
  std::string section;  ///< dotted path; empty: the top of the file
  std::string about;    ///< of the section
  std::vector<ConfigKey> keys;
};
/// The keys of a kind by section, in the order of the sections.
std::vector<KeyGroup> groups_of(const ConfigKind& kind);
/// The part of a key's name behind its section.
std::string name_in_section(const ConfigKey& key);
/// The key most similar to an unknown name; empty if none is similar.
std::string nearest_key(const std::vector<ConfigKind>& reference, const std::string& name);

}  // namespace earshot
