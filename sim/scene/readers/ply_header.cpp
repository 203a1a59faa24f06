// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/readers/ply_header.h"

#include <fmt/format.h>

#include <charconv>
#include <map>

#include "sim/base/errors.h"
#include "sim/scene/readers/text_scanner.h"

namespace earshot {
namespace {

std::optional<PlyType> type_named(std::string_view name) {
  static const std::map<std::string_view, PlyType> types{
      {"char", PlyType::int8},     {"uchar", PlyType::uint8},     {"int8", PlyType::int8},      {"uint8", PlyType::uint8},
      {"short", PlyType::int16},   {"ushort", PlyType::uint16},   {"int16", PlyType::int16},    {"uint16", PlyType::uint16},
      {"int", PlyType::int32},     {"uint", PlyType::uint32},     {"int32", PlyType::int32},    {"uint32", PlyType::uint32},
      {"float", PlyType::float32}, {"float32", PlyType::float32}, {"double", PlyType::float64}, {"float64", PlyType::float64}};
  const auto found = types.find(name);
  return found == types.end() ? std::nullopt : std::optional(found->second);
}

class PlyHeaderParser {
 public:
  PlyHeaderParser(std::string_view bytes, const std::string& where) : bytes_(bytes), where_(where) {}

  PlyHeader parse(PlyPart part) {
    find_line_break();
    for (bool is_first = true;; is_first = false) {
      const std::string_view line = next_line();
      split_words(line, words_);
      if (is_first) {
        if (words_.size() != 1 || words_[0] != "ply") fail("is not a PLY file");
      } else if (words_.empty()) {
        wrong_line();
      } else if (words_[0] == "end_header") {
        if (words_.size() != 1) wrong_line();
        break;
      } else {
        take_line();
      }
    }
    header_.body_begin = at_;
    if (!has_format_) fail("PLY header has no format line");
    if (part == PlyPart::whole) check_size();
    return std::move(header_);
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const {
    throw InputError(where_, problem, "check the file in a mesh viewer or export it again");
  }
  [[noreturn]] void wrong_line() const { fail(fmt::format("PLY header line {} is not valid", header_.num_lines)); }

  void find_line_break() {
    if (!bytes_.starts_with("ply")) fail("is not a PLY file");
    const std::size_t end = bytes_.find_first_of("\r\n");
    if (end == std::string_view::npos) fail("PLY header has no end_header (line 1)");
    line_break_ = bytes_.substr(end, bytes_.substr(end).starts_with("\r\n") ? 2 : 1);
  }

  std::string_view next_line() {
    constexpr std::size_t longest = 4096;
    ++header_.num_lines;
    const std::size_t end = bytes_.find(line_break_, at_);
    if (end == std::string_view::npos || end - at_ > longest)
      fail(fmt::format("PLY header has no end_header (line {})", header_.num_lines));
    const std::string_view line = bytes_.substr(at_, end - at_);
    at_ = end + line_break_.size();
    return line;
  }

  void take_line() {
    if (words_[0] == "comment" || words_[0] == "obj_info") return;
    if (words_[0] == "format")
      take_format();
    else if (words_[0] == "element")
      take_element();
    else if (words_[0] == "property")
      take_property();
    else
      wrong_line();
  }

  void take_format() {
    if (words_.size() != 3 || words_[2] != "1.0") wrong_line();
    static const std::map<std::string_view, PlyHeader::Body> bodies{{"ascii", PlyHeader::Body::ascii},
                                                                    {"binary_little_endian", PlyHeader::Body::little_endian},
                                                                    {"binary_big_endian", PlyHeader::Body::big_endian}};
    const auto found = bodies.find(words_[1]);
    if (found == bodies.end()) wrong_line();
    header_.body = found->second;
    has_format_ = true;
  }

  void take_element() {
    if (words_.size() != 3) wrong_line();
    std::uint64_t count = 0;
    const auto [stop, error] = std::from_chars(words_[2].data(), words_[2].data() + words_[2].size(), count);
    if (error != std::errc() || stop != words_[2].data() + words_[2].size()) wrong_line();
    header_.elements.push_back({std::string(words_[1]), count, {}});
  }

  void take_property() {
    const bool is_list = words_.size() == 5 && words_[1] == "list";
    if (!(is_list || words_.size() == 3) || header_.elements.empty()) wrong_line();
    const auto type = type_named(words_[is_list ? 3 : 1]);
    const auto count_type = is_list ? type_named(words_[2]) : std::nullopt;
    if (!type || (is_list && !count_type)) wrong_line();
    header_.elements.back().properties.push_back({std::string(words_.back()), *type, count_type});
  }

  /// In double: counts may be absurd.
  void check_size() const {
    double body_bytes = 0;
    for (const PlyElement& element : header_.elements) {
      for (const PlyProperty& property : element.properties) {
        // Of text a digit and a separator; of a list its length.
        const std::size_t size = header_.body == PlyHeader::Body::ascii ? 2 : size_of(property.count_type.value_or(property.type));
        body_bytes += static_cast<double>(element.count) * static_cast<double>(size);
      }
    }
    const std::size_t rest = bytes_.size() - at_;
    if (body_bytes > static_cast<double>(rest) + (header_.body == PlyHeader::Body::ascii ? 1 : 0))
      fail(fmt::format("PLY header declares at least {:.0f} bytes of data, but the file has {}", body_bytes, rest));
  }

  std::string_view bytes_, line_break_;
  const std::string& where_;
  std::size_t at_ = 0;
  PlyHeader header_;
  bool has_format_ = false;
  std::vector<std::string_view> words_;
};

}  // namespace

std::size_t size_of(PlyType type) {
  switch (type) {
    case PlyType::int8:
    case PlyType::uint8:
      return 1;
    case PlyType::int16:
    case PlyType::uint16:
      return 2;
    case PlyType::int32:
    case PlyType::uint32:
    case PlyType::float32:
      return 4;
    case PlyType::float64:
      return 8;
  }
  return 1;
}

PlyHeader parse_ply_header(std::string_view bytes, const std::string& where, PlyPart part) {
  return PlyHeaderParser(bytes, where).parse(part);
}

bool is_corner_list(const PlyProperty& property) {
  return property.count_type && (property.name == "vertex_indices" || property.name == "vertex_index");
}

}  // namespace earshot
