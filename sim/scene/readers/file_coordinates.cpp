#include "sim/scene/readers/file_coordinates.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <glm/common.hpp>
#include <limits>
#include <optional>
#include <string_view>
#include <vector>

#include "sim/scene/mesh/triangle_mesh.h"
#include "sim/scene/readers/ply_header.h"

namespace earshot {
namespace {

/// A number as it stands in the file.
struct Token {
  std::size_t begin = 0, end = 0;
};

/// Three numbers that are one position.
struct Position {
  std::array<Token, 3> text;
  glm::dvec3 value{0};
};

constexpr std::string_view blank = " \t\r";

/// Words of the line [begin, end) of `bytes`, at most `most`.
void split_line(std::string_view bytes, std::size_t begin, std::size_t end, std::size_t most, std::vector<Token>& words) {
  words.clear();
  while (words.size() < most) {
    while (begin < end && blank.find(bytes[begin]) != std::string_view::npos) ++begin;
    if (begin >= end) break;
    Token word{begin, begin};
    while (word.end < end && blank.find(bytes[word.end]) == std::string_view::npos) ++word.end;
    words.push_back(word);
    begin = word.end;
  }
}

/// Locale-free; nullopt for anything but a finite number.
std::optional<double> parse_number(std::string_view text) {
  if (text.starts_with('+')) text.remove_prefix(1);
  double value = 0;
  const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || stop != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

std::optional<Position> parse_position(std::string_view bytes, const std::array<Token, 3>& text) {
  Position position{text, {}};
  for (int axis = 0; axis < 3; ++axis) {
    const Token token = text[static_cast<std::size_t>(axis)];
    const auto value = parse_number(bytes.substr(token.begin, token.end - token.begin));
    if (!value) return std::nullopt;
    position.value[axis] = *value;
  }
  return position;
}

std::size_t line_end(std::string_view bytes, std::size_t begin) { return std::min(bytes.find('\n', begin), bytes.size()); }

/// Visits the lines "keyword x y z" of an OBJ ("v") or a text STL ("vertex").  False if one of them is not three numbers.
template <class Visit>
bool visit_keyword_lines(std::string_view bytes, std::string_view keyword, Visit visit) {
  std::vector<Token> words;
  for (std::size_t begin = 0; begin < bytes.size();) {
    const std::size_t end = line_end(bytes, begin);
    split_line(bytes, begin, end, 6, words);
    begin = end + 1;
    if (words.empty() || bytes.substr(words[0].begin, words[0].end - words[0].begin) != keyword) continue;
    // Five words: the fourth number of an OBJ divides the others.
    if (words.size() < 4 || words.size() == 5) return false;
    const auto position = parse_position(bytes, {words[1], words[2], words[3]});
    if (!position) return false;
    visit(*position);
  }
  return true;
}

/// The same for the vertices of a text PLY.
template <class Visit>
bool visit_ply_lines(std::string_view bytes, const PlyVertices& vertices, Visit visit) {
  std::size_t begin = vertices.body_begin;
  for (std::uint64_t skipped = 0; skipped < vertices.elements_before && begin < bytes.size(); ++skipped) begin = line_end(bytes, begin) + 1;
  std::vector<Token> words;
  for (std::uint64_t i = 0; i < vertices.count; ++i) {
    if (begin >= bytes.size()) return false;
    const std::size_t end = line_end(bytes, begin);
    split_line(bytes, begin, end, vertices.num_properties, words);
    begin = end + 1;
    if (words.size() < vertices.num_properties) return false;
    const auto position = parse_position(bytes, {words[vertices.xyz[0]], words[vertices.xyz[1]], words[vertices.xyz[2]]});
    if (!position) return false;
    visit(*position);
  }
  return true;
}

double load_double(const char* from, bool big_endian) {
  std::array<char, sizeof(double)> raw;
  std::memcpy(raw.data(), from, raw.size());
  if (big_endian) std::reverse(raw.begin(), raw.end());
  return std::bit_cast<double>(raw);
}

void store_double(char* to, double value, bool big_endian) {
  auto raw = std::bit_cast<std::array<char, sizeof(double)>>(value);
  if (big_endian) std::reverse(raw.begin(), raw.end());
  std::memcpy(to, raw.data(), raw.size());
}

struct DoubleBounds {
  glm::dvec3 lower{std::numeric_limits<double>::infinity()}, upper{-std::numeric_limits<double>::infinity()};
  void include(glm::dvec3 position) {
    lower = glm::min(lower, position);
    upper = glm::max(upper, position);
  }
};

/// visit_positions(bytes, visit) -> bool calls visit for each position in the order of the text.
template <class VisitPositions>
glm::dvec3 move_text(std::string& bytes, VisitPositions visit_positions) {
  DoubleBounds bounds;
  if (!visit_positions(bytes, [&](const Position& position) { bounds.include(position.value); })) return glm::dvec3(0);
  const glm::dvec3 origin = origin_near(bounds.lower, bounds.upper);
  if (origin == glm::dvec3(0)) return origin;
  std::string moved;
  moved.reserve(bytes.size());
  std::size_t copied = 0;
  visit_positions(bytes, [&](const Position& position) {
    for (int axis = 0; axis < 3; ++axis) {
      const Token token = position.text[static_cast<std::size_t>(axis)];
      moved.append(bytes, copied, token.begin - copied);
      // The shortest text of the float: what a modeller would have written near zero.
      moved += fmt::format("{}", static_cast<float>(position.value[axis] - origin[axis]));
      copied = token.end;
    }
  });
  moved.append(bytes, copied);
  bytes = std::move(moved);
  return origin;
}

glm::dvec3 prepare_ply(std::string& bytes) {
  // Assimp takes a carriage return before a binary body for its first byte.
  const std::size_t header_end = end_of_ply_header(bytes);
  if (header_end == std::string::npos) return glm::dvec3(0);
  std::string header = bytes.substr(0, header_end);
  if (std::erase(header, '\r') > 0) bytes = header + bytes.substr(header_end);

  const std::optional<PlyVertices> vertices = find_ply_vertices(bytes);
  if (!vertices) return glm::dvec3(0);
  if (vertices->ascii) return move_text(bytes, [&](std::string_view text, auto visit) { return visit_ply_lines(text, *vertices, visit); });
  if (!vertices->doubles || vertices->elements_before > 0) return glm::dvec3(0);
  if (vertices->count > (bytes.size() - vertices->body_begin) / vertices->bytes_per_vertex) return glm::dvec3(0);
  const auto at = [&](std::size_t i, std::size_t axis) {
    return bytes.data() + vertices->body_begin + i * vertices->bytes_per_vertex + vertices->xyz_bytes[axis];
  };
  DoubleBounds bounds;
  for (std::size_t i = 0; i < vertices->count; ++i) {
    const glm::dvec3 position(load_double(at(i, 0), vertices->big_endian), load_double(at(i, 1), vertices->big_endian),
                              load_double(at(i, 2), vertices->big_endian));
    if (!std::isfinite(position.x + position.y + position.z)) return glm::dvec3(0);
    bounds.include(position);
  }
  const glm::dvec3 origin = origin_near(bounds.lower, bounds.upper);
  if (origin == glm::dvec3(0)) return origin;
  for (std::size_t i = 0; i < vertices->count; ++i)
    for (std::size_t axis = 0; axis < 3; ++axis)
      store_double(at(i, axis), load_double(at(i, axis), vertices->big_endian) - origin[static_cast<int>(axis)], vertices->big_endian);
  return origin;
}

/// 80 bytes of text, a count, and 50 bytes per triangle.
bool is_binary_stl(std::string_view bytes) {
  if (bytes.size() < 84) return false;
  std::uint32_t count = 0;
  std::memcpy(&count, bytes.data() + 80, sizeof count);
  return bytes.size() == 84 + 50 * std::uint64_t{count};
}

}  // namespace

glm::dvec3 prepare_coordinates(std::string& bytes, CoordinateText format) {
  if (format == CoordinateText::stl && is_binary_stl(bytes)) return glm::dvec3(0);
  if (bytes.starts_with("\xEF\xBB\xBF")) bytes.erase(0, 3);
  if (format == CoordinateText::ply) return prepare_ply(bytes);
  const std::string_view keyword = format == CoordinateText::obj ? "v" : "vertex";
  return move_text(bytes, [&](std::string_view text, auto visit) { return visit_keyword_lines(text, keyword, visit); });
}

}  // namespace earshot
