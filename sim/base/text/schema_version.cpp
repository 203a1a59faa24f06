// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/schema_version.h"

#include <fmt/format.h>

#include "sim/base/errors.h"
#include "sim/base/version.h"

namespace earshot {

void check_schema_version(std::string_view where, std::string_view kind, std::int64_t found, SchemaRange range) {
  if (found >= range.oldest && found <= range.newest) return;
  const std::string reads =
      range.oldest == range.newest ? fmt::format("version {}", range.newest) : fmt::format("versions {} to {}", range.oldest, range.newest);
  throw InputError(where, fmt::format("is {} of version {}, but earshot {} reads {}", kind, found, kVersion, reads),
                   found > range.newest ? "use a newer earshot" : "use the version of earshot that wrote it");
}

}  // namespace earshot
