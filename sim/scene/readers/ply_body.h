// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "sim/scene/readers/ply_header.h"
#include "sim/scene/readers/text_scanner.h"

namespace earshot {

/// The numbers behind the header of a PLY file, one after the other.  Throws InputError where the body ends before its header says, and for
/// text that is not a number.
class PlyBody {
 public:
  PlyBody(std::string_view bytes, const PlyHeader& header, const std::string& where);

  double number(PlyType type);
  void skip(PlyType type);
  /// A number of a list, or its length; throws for a fraction.
  std::int64_t whole(PlyType type);
  /// Behind the last number of an element.  In a text an element ends with its line.
  void end_element();
  /// Behind the last element: a doubt of a text, a warning of a binary body, or nothing.  Throws for text that follows.
  [[nodiscard]] std::string end();
  [[nodiscard]] std::size_t bytes_left() const { return bytes_.size() - at_; }

 private:
  std::string_view word();
  std::string_view take(std::size_t size);
  [[noreturn]] void fail(const std::string& problem) const;
  /// The next line of a text that is neither blank nor a comment.
  bool next_line();

  std::string_view bytes_;
  PlyHeader::Body body_;
  const std::string& where_;
  std::size_t at_ = 0;  ///< of a binary body
  LineScanner lines_;   ///< of a text
  std::size_t lines_before_;
  std::string_view line_;
};

}  // namespace earshot
