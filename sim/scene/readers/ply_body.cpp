// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/readers/ply_body.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>

#include "sim/base/errors.h"
#include "sim/scene/readers/mesh_builder.h"

namespace earshot {
namespace {

template <class T>
double load_number(std::string_view raw, bool big_endian) {
  std::array<char, sizeof(T)> bytes;
  std::memcpy(bytes.data(), raw.data(), bytes.size());
  if (big_endian) std::reverse(bytes.begin(), bytes.end());
  return static_cast<double>(std::bit_cast<T>(bytes));
}

}  // namespace

PlyBody::PlyBody(std::string_view bytes, const PlyHeader& header, const std::string& where)
    : bytes_(bytes.substr(header.body_begin)), body_(header.body), where_(where), lines_(bytes_), lines_before_(header.num_lines) {}

void PlyBody::fail(const std::string& problem) const {
  throw InputError(where_, problem, "check the file in a mesh viewer or export it again");
}

bool PlyBody::next_line() {
  while (lines_.next()) {
    line_ = lines_.line();
    std::string_view rest = line_;
    const std::string_view first = take_word(rest);
    if (!first.empty() && first != "comment" && first != "obj_info") return true;
  }
  line_ = {};
  return false;
}

std::string_view PlyBody::word() {
  for (;;) {
    const std::string_view found = take_word(line_);
    if (!found.empty()) return found;
    if (!next_line()) fail("ends before all elements that its PLY header declares");
  }
}

std::string_view PlyBody::take(std::size_t size) {
  if (size > bytes_left()) fail("ends before all elements that its PLY header declares");
  const std::string_view raw = bytes_.substr(at_, size);
  at_ += size;
  return raw;
}

double PlyBody::number(PlyType type) {
  if (body_ == PlyHeader::Body::ascii) {
    const std::string_view text = word();
    const auto value = parse_decimal(text);
    if (!value) fail(fmt::format("line {}: '{}' is not a number", lines_before_ + lines_.number(), one_line(std::string(text))));
    return *value;
  }
  const std::string_view raw = take(size_of(type));
  const bool big = body_ == PlyHeader::Body::big_endian;
  switch (type) {
    case PlyType::int8:
      return load_number<std::int8_t>(raw, big);
    case PlyType::uint8:
      return load_number<std::uint8_t>(raw, big);
    case PlyType::int16:
      return load_number<std::int16_t>(raw, big);
    case PlyType::uint16:
      return load_number<std::uint16_t>(raw, big);
    case PlyType::int32:
      return load_number<std::int32_t>(raw, big);
    case PlyType::uint32:
      return load_number<std::uint32_t>(raw, big);
    case PlyType::float32:
      return load_number<float>(raw, big);
    case PlyType::float64:
      return load_number<double>(raw, big);
  }
  return 0;
}

void PlyBody::skip(PlyType type) {
  if (body_ == PlyHeader::Body::ascii)
    word();
  else
    take(size_of(type));
}

std::int64_t PlyBody::whole(PlyType type) {
  const double value = number(type);
  if (!(std::fabs(value) <= 0x1p52) || value != std::floor(value)) fail(fmt::format("the list entry {} is not a whole number", value));
  return static_cast<std::int64_t>(value);
}

void PlyBody::end_element() {
  if (body_ == PlyHeader::Body::ascii && !trimmed(line_).empty())
    fail(fmt::format("line {} has more numbers than the PLY header declares", lines_before_ + lines_.number()));
}

std::string PlyBody::end() {
  if (body_ != PlyHeader::Body::ascii)
    return bytes_left() == 0 ? "" : fmt::format("{} extra bytes after the last element of the PLY header", bytes_left());
  const bool ends_in_break = lines_.has_break();
  while (next_line()) {
    if (trimmed(line_).find_first_not_of(std::string_view("\x1A\0", 2)) != std::string_view::npos)
      fail(fmt::format("line {} comes after the last element of the PLY header", lines_before_ + lines_.number()));
  }
  return ends_in_break ? "" : "the last line has no line break; check that the file is complete";
}

}  // namespace earshot
