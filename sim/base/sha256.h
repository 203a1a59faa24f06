// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace earshot {

/// SHA-256 (FIPS 180-4) as 64 hexadecimal digits, as `sha256sum` prints it: commits to bytes that are not published yet.  Use hash64 to
/// tell sets and builds apart.  About 200 MB/s.
std::string sha256_hex(std::string_view bytes);

}  // namespace earshot
