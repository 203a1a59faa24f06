// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "sim/base/errors.h"

namespace earshot {

/// Values one after the other as bytes, for another process of the same program and machine, or a file behind a hash and a version: native
/// order, no padding.
class ByteWriter {
 public:
  template <class T>
  void put(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
  }
  /// The number of elements, then the elements.
  template <class T>
  void put_list(std::span<const T> values) {
    static_assert(std::is_trivially_copyable_v<T>);
    put(static_cast<std::uint64_t>(values.size()));
    if (!values.empty()) bytes_.append(reinterpret_cast<const char*>(values.data()), values.size_bytes());
  }
  template <class T>
  void put_list(const std::vector<T>& values) {
    put_list(std::span<const T>(values));
  }
  void put_text(std::string_view text) { put_list(std::span<const char>(text.data(), text.size())); }

  [[nodiscard]] std::string take() { return std::move(bytes_); }

 private:
  std::string bytes_;
};

/// Reads what ByteWriter wrote.  It may be damaged, as by the file that another process read, so every length is checked against the bytes
/// that are left: a length beyond them throws InputError naming `where`.
class ByteReader {
 public:
  ByteReader(std::string_view bytes, std::string where, std::string problem = "is damaged: its reader sent an invalid answer",
             std::string remedy = "export or download the file again")
      : bytes_(bytes), where_(std::move(where)), problem_(std::move(problem)), remedy_(std::move(remedy)) {}

  template <class T>
  T take() {
    static_assert(std::is_trivially_copyable_v<T>);
    if (bytes_.size() < sizeof(T)) fail();
    T value;
    std::memcpy(&value, bytes_.data(), sizeof value);
    bytes_.remove_prefix(sizeof value);
    return value;
  }
  template <class T>
  std::vector<T> take_list() {
    const auto size = take<std::uint64_t>();
    if (size > bytes_.size() / sizeof(T)) fail();
    std::vector<T> values(static_cast<std::size_t>(size));
    if (!values.empty()) std::memcpy(values.data(), bytes_.data(), values.size() * sizeof(T));
    bytes_.remove_prefix(values.size() * sizeof(T));
    return values;
  }
  std::string take_text() {
    const std::vector<char> letters = take_list<char>();
    return {letters.begin(), letters.end()};
  }
  /// Throws InputError if bytes are left.
  void finish() const {
    if (!bytes_.empty()) fail();
  }
  /// Call for what is read but cannot be.
  void check(bool holds) const {
    if (!holds) fail();
  }
  [[noreturn]] void fail() const { throw InputError(where_, problem_, remedy_); }

 private:
  std::string_view bytes_;
  std::string where_, problem_, remedy_;
};

}  // namespace earshot
