// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <string_view>

namespace earshot {

/// Types of array elements, as NumPy names them.
inline constexpr std::string_view kFloat32 = "<f4", kUint8 = "|u1";

/// The bytes of a NumPy file, format 1.0 (numpy.lib.format): `data` in row-major order.
std::string encode_npy(std::string_view type, std::span<const std::size_t> shape, std::string_view data);

/// `.zarray` of an array without compression in Zarr format 2: chunk files are named by their indices, joined by dots, and hold their
/// elements in row-major order.  Chunks that reach over the border are whole, zero there.
nlohmann::ordered_json zarr_array(std::string_view type, std::span<const std::size_t> shape, std::span<const std::size_t> chunks);

}  // namespace earshot
