#include "sim/scene/readers/ply_header.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <map>
#include <vector>

#include "sim/base/errors.h"
#include "sim/scene/readers/mesh_builder.h"

namespace earshot {
namespace {

std::vector<std::string_view> split_words(std::string_view line) {
  std::vector<std::string_view> words;
  for (;;) {
    const std::size_t begin = line.find_first_not_of(" \t\r");
    if (begin == std::string_view::npos) return words;
    line.remove_prefix(begin);
    const std::size_t end = std::min(line.find_first_of(" \t\r"), line.size());
    words.push_back(line.substr(0, end));
    line.remove_prefix(end);
  }
}

std::size_t size_of_type(std::string_view name) {  // 0: unknown
  static const std::map<std::string_view, std::size_t> sizes{
      {"char", 1}, {"uchar", 1}, {"int8", 1},  {"uint8", 1},  {"short", 2}, {"ushort", 2},  {"int16", 2},  {"uint16", 2},
      {"int", 4},  {"uint", 4},  {"int32", 4}, {"uint32", 4}, {"float", 4}, {"float32", 4}, {"double", 8}, {"float64", 8}};
  const auto found = sizes.find(name);
  return found == sizes.end() ? 0 : found->second;
}

}  // namespace

void check_ply_header(std::string_view bytes, const std::string& where) {
  const auto fail = [&](const std::string& what) { throw InputError(where, what, "check the file in a mesh viewer or export it again"); };
  bool first_line = true, has_format = false, ascii = false;
  double body_bytes = 0;  // double: counts may be absurd
  double element_count = -1;
  for (std::size_t line_number = 1;; ++line_number) {
    const std::size_t end = bytes.find('\n');
    if (end == std::string_view::npos || end > 4096) fail(fmt::format("PLY header has no end_header (line {})", line_number));
    const std::vector<std::string_view> words = split_words(bytes.substr(0, end));
    bytes.remove_prefix(end + 1);
    const auto wrong_line = [&] { fail(fmt::format("PLY header line {} is not understood", line_number)); };
    if (first_line) {
      if (words.size() != 1 || words[0] != "ply") fail("is not a PLY file");
      first_line = false;
    } else if (words.empty()) {
      wrong_line();
    } else if (words[0] == "end_header") {
      if (words.size() != 1) wrong_line();
      break;
    } else if (words[0] == "comment" || words[0] == "obj_info") {
      continue;
    } else if (words[0] == "format") {
      if (words.size() != 3 || words[2] != "1.0") wrong_line();
      ascii = words[1] == "ascii";
      has_format = ascii || words[1] == "binary_little_endian" || words[1] == "binary_big_endian";
      if (!has_format) wrong_line();
    } else if (words[0] == "element") {
      std::uint64_t count = 0;
      if (words.size() != 3) wrong_line();
      const auto [stop, error] = std::from_chars(words[2].data(), words[2].data() + words[2].size(), count);
      if (error != std::errc() || stop != words[2].data() + words[2].size()) wrong_line();
      element_count = static_cast<double>(count);
    } else if (words[0] == "property") {
      const bool list = words.size() == 5 && words[1] == "list";
      if (!(list || words.size() == 3) || element_count < 0) wrong_line();
      const std::size_t size = size_of_type(words[list ? 2 : 1]);
      if (size == 0 || (list && size_of_type(words[3]) == 0)) wrong_line();
      body_bytes += element_count * (ascii ? 2.0 : static_cast<double>(size));  // a digit and a separator, or the value (a list's length)
    } else {
      wrong_line();
    }
  }
  if (!has_format) fail("PLY header has no format line");
  if (body_bytes > static_cast<double>(bytes.size()) + 1)
    fail(fmt::format("PLY header promises at least {:.0f} bytes of data, {} are there", body_bytes, bytes.size()));
}

std::size_t end_of_ply_header(std::string_view bytes) {
  for (std::size_t begin = 0; begin < bytes.size();) {
    const std::size_t end = bytes.find('\n', begin);
    if (end == std::string_view::npos) break;
    const std::vector<std::string_view> words = split_words(bytes.substr(begin, end - begin));
    begin = end + 1;
    if (words.size() == 1 && words[0] == "end_header") return begin;
  }
  return std::string_view::npos;
}

std::optional<PlyVertices> find_ply_vertices(std::string_view bytes) {
  PlyVertices found;
  found.body_begin = end_of_ply_header(bytes);
  if (found.body_begin == std::string_view::npos) return std::nullopt;
  enum class Place { before, inside, after } place = Place::before;
  std::array<bool, 3> has{};
  std::array<bool, 3> is_double{};
  for (std::size_t begin = 0; begin < found.body_begin;) {
    const std::size_t end = bytes.find('\n', begin);
    const std::vector<std::string_view> words = split_words(bytes.substr(begin, end - begin));
    begin = end + 1;
    if (words.size() == 3 && words[0] == "format") {
      found.ascii = words[1] == "ascii";
      found.big_endian = words[1] == "binary_big_endian";
    } else if (words.size() == 3 && words[0] == "element") {
      if (place == Place::inside) place = Place::after;
      std::uint64_t count = 0;
      std::from_chars(words[2].data(), words[2].data() + words[2].size(), count);
      if (words[1] == "vertex" && place == Place::before) {
        place = Place::inside;
        found.count = count;
      } else if (place == Place::before) {
        found.elements_before += count;
      }
    } else if (words.size() >= 3 && words[0] == "property" && place == Place::inside) {
      if (words.size() != 3) return std::nullopt;  // a list
      for (std::size_t axis = 0; axis < 3; ++axis) {
        if (words[2] != std::string_view("xyz").substr(axis, 1)) continue;
        has[axis] = true;
        is_double[axis] = size_of_type(words[1]) == 8;
        found.xyz[axis] = found.num_properties;
        found.xyz_bytes[axis] = found.bytes_per_vertex;
      }
      ++found.num_properties;
      found.bytes_per_vertex += size_of_type(words[1]);
    }
  }
  found.doubles = is_double[0] && is_double[1] && is_double[2];
  if (!(has[0] && has[1] && has[2]) || found.bytes_per_vertex == 0) return std::nullopt;
  return found;
}

}  // namespace earshot
