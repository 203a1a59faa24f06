// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

namespace earshot {

/// read_file for files that come from others: throws InputError at once for a device, a pipe or a socket, which may never end, and for a
/// file over `max_bytes`.
std::string read_regular_file(const std::filesystem::path& path, std::size_t max_bytes);

}  // namespace earshot
