// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/readers/stl_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "sim/base/errors.h"
#include "sim/base/text/text_match.h"
#include "sim/scene/readers/mesh_builder.h"
#include "sim/scene/readers/text_scanner.h"

namespace earshot {
namespace {

static_assert(std::endian::native == std::endian::little, "STL is little endian");

constexpr std::size_t kStlHeaderBytes = 84, kStlFacetBytes = 50;
constexpr const char* kStlMaterial = "DefaultMaterial";

/// Five bits per channel, used if the highest bit is set; VisCAM has blue in the lowest bits, Materialise red.
glm::vec3 facet_color(std::uint16_t attribute, bool is_materialise) {
  if ((attribute & 0x8000u) == 0) return glm::vec3(1);
  const glm::vec3 low_first = glm::vec3(attribute & 31u, attribute >> 5 & 31u, attribute >> 10 & 31u) / 31.f;
  return is_materialise ? low_first : glm::vec3(low_first.z, low_first.y, low_first.x);
}

MeshFile parse_binary_stl(std::string_view bytes, std::uint32_t count, const std::string& where, const std::string& object,
                          bool with_looks) {
  const std::size_t stored_facets = (bytes.size() - kStlHeaderBytes) / kStlFacetBytes;
  const std::size_t left = bytes.size() - kStlHeaderBytes - std::min<std::size_t>(count, stored_facets) * kStlFacetBytes;
  if (count > stored_facets || (left >= kStlFacetBytes && left % kStlFacetBytes == 0))
    throw InputError(where, fmt::format("declares {} triangles in its header, but contains {}", count, stored_facets),
                     "copy or export it again");
  MeshFile file{.parts = {}, .num_faces = 0, .warnings = {}};
  MeshPart part{.object = object, .material = kStlMaterial, .positions = {}, .corners = {}, .has_floats = true};
  const bool is_materialise = bytes.substr(0, 80).find("COLOR=") != std::string_view::npos;
  bool has_color = false;
  FaceCutter cutter(where);
  for (std::size_t i = 0; i < count; ++i) {
    const std::string_view facet = bytes.substr(kStlHeaderBytes + i * kStlFacetBytes, kStlFacetBytes);
    std::array<float, 9> xyz;
    std::uint16_t attribute = 0;
    std::memcpy(xyz.data(), facet.data() + 12, sizeof xyz);
    std::memcpy(&attribute, facet.data() + 48, sizeof attribute);
    const auto first = static_cast<std::uint32_t>(part.positions.size());
    for (std::size_t c = 0; c < 9; c += 3) part.positions.emplace_back(xyz[c], xyz[c + 1], xyz[c + 2]);
    cutter.add(std::array{first, first + 1, first + 2}, part);
    has_color = has_color || (attribute & 0x8000u) != 0;
    if (with_looks) part.colors.insert(part.colors.end(), 3, facet_color(attribute, is_materialise));
  }
  if (!has_color) part.colors.clear();
  file.num_faces = cutter.num_faces();
  file.parts.push_back(std::move(part));
  if (left > 0) file.warnings.push_back(fmt::format("{} extra bytes after the {} triangles of the header", left, count));
  return file;
}

class StlTextParser {
 public:
  StlTextParser(std::string_view bytes, const std::string& where, const std::string& object)
      : lines_(bytes), where_(where), object_(object), cutter_(where) {}

  MeshFile parse() {
    while (next_word()) {
      if (word_ == "solid") {
        begin_solid();
      } else if (word_ == "endsolid") {
        rest_ = {};
        is_open_ = false;
      } else if (word_ == "facet") {
        read_facet();
      } else {
        if (num_unknown_++ == 0) unknown_ = fmt::format("line {}: '{}'", lines_.number(), one_line(word_));
        rest_ = {};
      }
    }
    MeshFile file{.parts = std::move(parts_), .num_faces = cutter_.num_faces(), .warnings = {}};
    if (is_open_) file.doubts.emplace_back("the last solid has no endsolid; check that the file is complete");
    if (num_unknown_ > 0) file.warnings.push_back(fmt::format("{} lines are not valid and are ignored ({})", num_unknown_, unknown_));
    if (const std::string warning = cutter_.warning(); !warning.empty()) file.warnings.push_back(warning);
    return file;
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const {
    throw InputError(where_, fmt::format("line {}: {}", lines_.number(), problem), "copy or export it again");
  }

  /// The next word in lower case; false at the end of the text.
  bool next_word() {
    std::string_view word = take_word(rest_);
    while (word.empty()) {
      if (!lines_.next()) return false;
      rest_ = lines_.line();
      word = take_word(rest_);
    }
    raw_word_ = word;
    word_ = fold_case(word);
    return true;
  }

  void expect(const char* wanted) {
    if (!next_word()) fail(fmt::format("the file ends within a facet, before '{}'", wanted));
    if (word_ != wanted) fail(fmt::format("found '{}' instead of '{}'", one_line(word_), wanted));
  }

  void begin_solid() {
    std::string_view name = rest_;
    const std::string first(take_word(name));
    parts_.push_back({.object = first.empty() ? object_ : first, .material = kStlMaterial, .positions = {}, .corners = {}});
    rest_ = {};
    is_open_ = true;
  }

  /// facet normal x y z outer loop, three or more vertices, endloop endfacet.  The corners decide the normal: that of the file is skipped.
  void read_facet() {
    constexpr int most_words_of_normal = 4;
    for (int i = 0;; ++i) {
      if (!next_word()) fail("the file ends within a facet");
      if (word_ == "outer") break;
      if (i == most_words_of_normal) fail("a facet has no 'outer loop'");
    }
    expect("loop");
    if (parts_.empty()) parts_.push_back({.object = object_, .material = kStlMaterial, .positions = {}, .corners = {}});
    MeshPart& part = parts_.back();
    face_.clear();
    for (;;) {
      if (!next_word()) fail("the file ends within a facet");
      if (word_ == "endloop") break;
      if (word_ != "vertex") fail(fmt::format("found '{}' instead of 'vertex'", one_line(word_)));
      face_.push_back(static_cast<std::uint32_t>(part.positions.size()));
      glm::dvec3 position(0);
      for (int axis = 0; axis < 3; ++axis) position[axis] = coordinate();
      part.positions.push_back(position);
    }
    expect("endfacet");
    cutter_.add(face_, part);
  }

  double coordinate() {
    if (!next_word()) fail("the file ends within a facet");
    const auto value = parse_decimal(raw_word_);
    if (!value) fail(fmt::format("'{}' is not a number", one_line(std::string(raw_word_))));
    return *value;
  }

  LineScanner lines_;
  const std::string& where_;
  const std::string& object_;
  FaceCutter cutter_;
  std::string_view rest_, raw_word_;
  std::string word_;
  bool is_open_ = false;
  std::size_t num_unknown_ = 0;
  std::string unknown_;
  std::vector<MeshPart> parts_;
  std::vector<std::uint32_t> face_;
};

}  // namespace

std::optional<std::uint32_t> binary_stl_count(std::string_view bytes) {
  if (bytes.size() < kStlHeaderBytes) return std::nullopt;
  std::uint32_t count = 0;
  std::memcpy(&count, bytes.data() + 80, sizeof count);
  // The four bytes of a text at this place count more triangles than a file of 6 GB holds.
  if (count <= (bytes.size() - kStlHeaderBytes) / kStlFacetBytes) return count;
  const std::size_t first = std::min(bytes.find_first_not_of(" \t\r\n\v\f"), bytes.size());
  const bool is_solid = fold_case(bytes.substr(first, 5)) == "solid";
  return is_solid && bytes.find('\0') == std::string_view::npos ? std::nullopt : std::optional(count);
}

MeshFile parse_stl(std::string_view bytes, const std::string& where, const std::string& object, bool with_looks) {
  if (const auto count = binary_stl_count(bytes)) return parse_binary_stl(bytes, *count, where, object, with_looks);
  return StlTextParser(bytes, where, object).parse();
}

}  // namespace earshot
