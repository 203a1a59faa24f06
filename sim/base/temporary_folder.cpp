// SPDX-License-Identifier: Apache-2.0
#include "sim/base/temporary_folder.h"

#include <stdlib.h>
#include <unistd.h>

#include <string>
#include <system_error>

#include "sim/base/errors.h"
#include "sim/base/file_descriptor.h"

namespace earshot {

std::filesystem::path temporary_parent() {
  const char* set = std::getenv("TMPDIR");
  const bool is_set = set != nullptr && *set != '\0';
  const std::filesystem::path parent = is_set ? set : "/tmp";
  const std::string name = is_set ? "TMPDIR=" + parent.string() : parent.string();
  constexpr const char* remedy = "set TMPDIR to a folder that can be written";
  std::error_code error;
  if (!std::filesystem::is_directory(parent, error)) throw InputError(name, "is not a folder", remedy);
  std::string probe = (parent / "earshot-XXXXXX").string();
  if (::mkdtemp(probe.data()) == nullptr) throw InputError(name, "cannot be written: " + last_error(), remedy);
  ::rmdir(probe.c_str());
  return parent;
}

TemporaryFolder::TemporaryFolder(const std::filesystem::path& parent, const char* prefix) {
  std::string name = (parent / (std::string(prefix) + "XXXXXX")).string();
  if (::mkdtemp(name.data()) == nullptr) throw RunError(name, "cannot be created: " + last_error());
  path_ = name;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

}  // namespace earshot
