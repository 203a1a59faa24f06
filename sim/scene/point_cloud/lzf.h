// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace earshot {

/// Expands data of LibLZF (literal runs and back references), as PCD files hold it.  nullopt unless the result has `size` bytes exactly,
/// and for a reference before its beginning; nothing is allocated for a size that so few bytes cannot reach.
std::optional<std::string> expand_lzf(std::string_view packed, std::size_t size);

}  // namespace earshot
