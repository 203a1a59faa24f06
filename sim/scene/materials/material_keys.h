// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "sim/base/text/config_key.h"

namespace earshot {

/// All keys of a material database (JSON): the one declaration by which its reader knows a key and its range, and of the reference.
/// Entries of the list are "materials[].NAME".
const std::vector<ConfigKey>& material_database_keys();
/// Names of the keys of an entry ("absorption"), or of the map `source` of an entry.
const std::set<std::string>& material_entry_keys();
const std::set<std::string>& material_source_keys();
/// One key of an entry, which must be among them.
const ConfigKey& material_entry_key(std::string_view name);

}  // namespace earshot
