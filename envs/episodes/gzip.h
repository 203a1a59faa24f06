// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace earshot {

/// Whether the text starts with the magic number of gzip (RFC 1952).
bool is_gzip(std::string_view bytes);

/// Inflates one or more gzip members.  Throws InputError naming `where`: damaged or cut stream, garbage behind it, more than
/// `max_bytes` of output (a small file may claim terabytes).
std::string gunzip(std::string_view bytes, const std::string& where, std::size_t max_bytes);

/// Deflates with an empty header (no name, no time): same input, same bytes.
std::string gzip(std::string_view bytes);

}  // namespace earshot
