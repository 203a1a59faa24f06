// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "sim/base/text/yaml_node.h"

namespace earshot {

/// A config text as a map: parsed, its merge keys replaced, the overrides "a.b.c=value" applied in their order.  A value is written as
/// behind the ':' of a key in a file.  An override changes its own key: what an alias names was copied before. has_keys: set to whether the
/// text has keys beside the overrides. Throws InputError as parse_yaml, and for a text that is no map, an override without '=', one through
/// a key that holds no map, and texts that the resolved config could not hold.
YamlNode load_config_tree(std::string_view yaml, const std::string& where, const std::vector<std::string>& overrides, bool& has_keys);

/// The node as YAML, which parse_yaml reads back to the same structure and texts.
std::string yaml_text(const YamlNode& node);
/// The same on one line.
std::string yaml_line(const YamlNode& node);

}  // namespace earshot
