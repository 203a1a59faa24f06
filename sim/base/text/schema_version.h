// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "sim/base/text/json_number.h"

namespace earshot {

/// Versions of one kind of file that this build reads.
struct SchemaRange {
  std::int64_t oldest = 1, newest = 1;
};

/// Checks the version that a file states (docs/reference/versions.md).
/// where: the file.  kind: kind of file, "a result".  found: the version in the file.
/// Throws InputError for a version outside the range: file, kind, its version, what this build reads, and which earshot to take.
void check_schema_version(std::string_view where, std::string_view kind, std::int64_t found, SchemaRange range);

/// The same for a JSON document that states its version under `key`; one without the key is of version 1.
/// Json: nlohmann::json, whose header the caller includes.  Throws json::exception if the version is not a whole number.
template <class Json>
void check_schema_version(const Json& document, const char* key, std::string_view where, std::string_view kind, SchemaRange range) {
  const bool is_stated = document.is_object() && document.contains(key);
  check_schema_version(where, kind, is_stated ? whole_number<std::int64_t>(document, key) : 1, range);
}

}  // namespace earshot
