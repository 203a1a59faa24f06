// SPDX-License-Identifier: Apache-2.0
#include "sim/base/temporary_folder.h"

#include <stdlib.h>

#include <cerrno>
#include <string>
#include <system_error>

#include "sim/base/errors.h"

namespace earshot {

TemporaryFolder::TemporaryFolder(const std::filesystem::path& parent, const char* prefix) {
  std::string name = (parent / (std::string(prefix) + "XXXXXX")).string();
  if (::mkdtemp(name.data()) == nullptr)
    throw RunError(name, "cannot be created: " + std::error_code(errno, std::generic_category()).message());
  path_ = name;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

}  // namespace earshot
