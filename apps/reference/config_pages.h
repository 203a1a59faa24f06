// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "apps/reference/config_reference.h"

namespace earshot {

/// The whole reference as tables for a terminal of this width (characters, at least 60).  A section that repeats another one names it, and
/// lists what differs.
std::string reference_text(const std::vector<ConfigKind>& reference, std::size_t width);
/// Description of a key, a section or a kind of file, in every kind that has it; empty if unknown.
std::string key_text(const std::vector<ConfigKind>& reference, const std::string& name, std::size_t width);
/// The page of the documentation site on config keys.
std::string reference_markdown(const std::vector<ConfigKind>& reference);
/// Every key with its declaration, with a schema_version.  name: only the keys that it stands for or that lie in it; empty: all.
std::string reference_json(const std::vector<ConfigKind>& reference, const std::string& name);

}  // namespace earshot
