// SPDX-License-Identifier: Apache-2.0
#include "sim/base/regular_file.h"

#include <fmt/format.h>

#include <system_error>

#include "sim/base/errors.h"
#include "sim/base/files.h"

namespace earshot {

std::string read_regular_file(const std::filesystem::path& path, std::size_t max_bytes) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (std::filesystem::exists(status) && !std::filesystem::is_directory(status)) {
    if (!std::filesystem::is_regular_file(status))
      throw InputError(path.string(), "is a device, a pipe or a socket, not a file", "write its content to a file, and give that");
    const auto size = std::filesystem::file_size(path, error);
    if (!error && size > max_bytes)
      throw InputError(path.string(), fmt::format("is larger than {} bytes", max_bytes), "check that it is the right file");
  }
  return read_file(path, max_bytes);
}

}  // namespace earshot
