// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

namespace earshot {

/// Whole file as bytes.  Throws InputError that names the file if it is missing, a folder, unreadable or over `max_bytes`.
std::string read_file(const std::filesystem::path& path, std::size_t max_bytes = std::size_t{4} << 30);

/// Writes to a temporary in the same folder, syncs it, then renames: the old file or the whole new one, never half.
/// Creates missing parent folders.  Throws RunError (disk full, no permission); the temporary is removed.
void write_file_atomically(const std::filesystem::path& path, std::string_view bytes);

/// XXH3, 64 bits: identity of scenes, configs, checkpoints.  Not for secrets.
std::uint64_t hash64(std::span<const std::byte> bytes, std::uint64_t seed = 0);
std::uint64_t hash64(std::string_view bytes, std::uint64_t seed = 0);
/// 16 lower-case hexadecimal digits.
std::string hex64(std::uint64_t value);

}  // namespace earshot
