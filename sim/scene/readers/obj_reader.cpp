// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/readers/obj_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <limits>
#include <unordered_map>

#include "sim/base/errors.h"
#include "sim/scene/readers/mesh_builder.h"
#include "sim/scene/readers/obj_materials.h"
#include "sim/scene/readers/text_scanner.h"

namespace earshot {
namespace {

constexpr std::uint32_t kNoUv = 0xFFFFFFFFu;
constexpr std::size_t kMaxVertices = 0xFFFFFFF0u;
constexpr std::size_t kLongestName = 4096;  // every part holds a copy

/// A statement: a line and those that continue it, without comment.
struct ObjStatement {
  std::string_view keyword, rest;
  std::size_t line = 0;
  bool has_break = true;  ///< as LineScanner::has_break
};

bool is_name_keyword(std::string_view word) { return word == "o" || word == "g" || word == "usemtl" || word == "mtllib"; }

/// Statements that hold no surface: smoothing, normals, display, and what free-form surfaces are made of.
bool is_without_surface(std::string_view word) {
  constexpr std::array<std::string_view, 27> known{"vn",    "vp",       "s",        "mg",         "maplib",    "usemap", "lod",
                                                   "bevel", "c_interp", "d_interp", "shadow_obj", "trace_obj", "cstype", "deg",
                                                   "bmat",  "step",     "curv",     "curv2",      "parm",      "trim",   "hole",
                                                   "scrv",  "sp",       "end",      "con",        "ctech",     "stech"};
  return std::find(known.begin(), known.end(), word) != known.end();
}

/// Whether a backslash is the last thing on the line.  Looks at its end alone.
bool is_continued(std::string_view line) {
  const std::size_t last = line.find_last_not_of(line_blanks);
  return last != std::string_view::npos && line[last] == '\\';
}

/// Joins continued lines.
class ObjStatements {
 public:
  explicit ObjStatements(std::string_view bytes) : lines_(bytes) {}

  bool next(ObjStatement& statement) {
    while (lines_.next()) {
      std::string_view rest = lines_.line();
      const std::string_view keyword = take_word(rest);
      if (keyword.empty() || keyword.starts_with('#')) continue;
      statement = {keyword, rest, lines_.number(), lines_.has_break()};
      if (is_name_keyword(keyword)) return true;
      statement.rest = rest.substr(0, rest.find('#'));
      if (statement.rest.size() == rest.size() && is_continued(rest)) join(statement);
      return true;
    }
    return false;
  }
  /// Of the whole text.
  [[nodiscard]] bool ends_in_break() const { return lines_.has_break(); }

 private:
  void join(ObjStatement& statement) {
    joined_ = statement.rest;
    while (is_continued(joined_)) {
      joined_.resize(joined_.rfind('\\'));
      joined_ += ' ';
      if (!lines_.next()) {
        statement.has_break = false;  // the line that continues it is not there
        break;
      }
      statement.has_break = lines_.has_break();
      const std::size_t comment = lines_.line().find('#');
      joined_ += lines_.line().substr(0, comment);
      if (comment != std::string_view::npos) break;
    }
    statement.rest = joined_;
  }

  LineScanner lines_;
  std::string joined_;
};

class ObjParser {
 public:
  ObjParser(std::string_view bytes, const std::string& where, const ObjOptions& options)
      : statements_(bytes), where_(where), options_(options), object_(options.default_object), material_(kDefaultMaterial) {}

  MeshFile parse() {
    ObjStatement last;
    while (statements_.next(statement_)) {
      last = statement_;
      if (last.keyword == "v")
        add_vertex();
      else if (last.keyword == "vt")
        add_uv();
      else if (last.keyword == "f" || last.keyword == "fo")
        add_face();
      else if (is_name_keyword(last.keyword))
        take_name();
      else
        pass_over();
    }
    check_end(last);
    return assemble();
  }

 private:
  static constexpr const char* kDefaultMaterial = "DefaultMaterial";

  struct Corner {
    std::uint32_t vertex, uv;
  };
  struct Face {
    std::size_t first = 0, count = 0, part = 0;
  };

  [[noreturn]] void fail(const std::string& problem) const {
    throw InputError(where_, fmt::format("line {}: {}", statement_.line, problem), "repair the line or export the mesh again");
  }

  double number(std::string_view word) const {
    const auto value = parse_decimal(word);
    if (!value) fail(fmt::format("'{}' is not a number", one_line(std::string(word))));
    return *value;
  }

  /// Three numbers; a fourth alone divides them, three or more behind them are a colour.
  void add_vertex() {
    split_words(statement_.rest, words_);
    if (words_.size() < 3) fail("a vertex (v) needs three numbers");
    glm::dvec3 position(number(words_[0]), number(words_[1]), number(words_[2]));
    if (words_.size() == 4) {
      const double divisor = number(words_[3]);
      if (divisor == 0) fail("the fourth number of a vertex (v) is zero");
      position /= divisor;
    }
    if (positions_.size() >= kMaxVertices) fail("has more than 4 billion vertices");
    positions_.push_back(position);
    if (!options_.with_looks) return;
    if (words_.size() >= 6) {
      colors_.resize(positions_.size() - 1, glm::vec3(1));
      colors_.emplace_back(number(words_[3]), number(words_[4]), number(words_[5]));
    }
  }

  void add_uv() {
    ++num_uvs_;
    if (!options_.with_looks) return;
    split_words(statement_.rest, words_);
    if (words_.empty()) fail("a texture coordinate (vt) has no numbers");
    uvs_.emplace_back(number(words_[0]), words_.size() > 1 ? number(words_[1]) : 0.0);
  }

  /// Counted from one, or backwards from the last one; a file may use a vertex before it defines it.
  std::optional<std::uint32_t> index(std::string_view text, std::size_t count) const {
    const auto value = parse_whole(text);
    if (!value || *value == 0) return std::nullopt;
    const std::int64_t at = *value > 0 ? *value - 1 : static_cast<std::int64_t>(count) + *value;
    if (at < 0 || at >= static_cast<std::int64_t>(kMaxVertices)) return std::nullopt;
    return static_cast<std::uint32_t>(at);
  }

  /// v, v/vt, v//vn or v/vt/vn.
  Corner corner(std::string_view word) {
    const auto wrong = [&] { fail(fmt::format("the face corner '{}' is not valid", one_line(std::string(word)))); };
    std::array<std::string_view, 3> fields;
    std::size_t count = 0;
    for (std::string_view left = word;; ++count) {
      if (count == 3) wrong();
      const std::size_t slash = left.find('/');
      fields[count] = left.substr(0, slash);
      if (slash == std::string_view::npos) break;
      left.remove_prefix(slash + 1);
    }
    const auto vertex = index(fields[0], positions_.size());
    if (!vertex) wrong();
    Corner made{*vertex, kNoUv};
    if (!fields[1].empty()) {
      if (!parse_whole(fields[1])) wrong();
      if (const auto uv = index(fields[1], num_uvs_)) made.uv = *uv;
    }
    if (!fields[2].empty() && !parse_whole(fields[2])) wrong();
    highest_used_ = std::max(highest_used_, std::size_t{*vertex} + 1);
    return made;
  }

  void add_face() {
    split_words(statement_.rest, words_);
    if (words_.empty()) fail("a face (f) has no corners");
    if (part_object_ != object_ || part_material_ != material_ || parts_.empty()) {
      parts_.push_back({.object = object_, .material = material_, .positions = {}, .corners = {}});
      part_object_ = object_;
      part_material_ = material_;
    }
    faces_.push_back({corners_.size(), words_.size(), parts_.size() - 1});
    for (const std::string_view word : words_) corners_.push_back(corner(word));
  }

  void take_name() {
    const std::string name(obj_name(statement_.rest));
    if (name.size() > kLongestName) fail(fmt::format("has a name of {} bytes", name.size()));
    if (statement_.keyword == "usemtl") material_ = name.empty() ? kDefaultMaterial : name;
    if ((statement_.keyword == "o" || statement_.keyword == "g") && !name.empty()) object_ = name;
  }

  void pass_over() {
    if (statement_.keyword == "surf")
      throw InputError(where_, fmt::format("line {}: has a free-form surface (surf)", statement_.line), "export it as polygons");
    if (statement_.keyword == "l" || statement_.keyword == "p") {
      split_words(statement_.rest, words_);
      for (const std::string_view word : words_) {
        if (const auto vertex = index(word.substr(0, word.find('/')), positions_.size()))
          highest_used_ = std::max(highest_used_, std::size_t{*vertex} + 1);
      }
    } else if (!is_without_surface(statement_.keyword) && num_unknown_++ == 0) {
      unknown_ = one_line(std::string(statement_.keyword));
      unknown_line_ = statement_.line;
    }
  }

  /// A file that was cut off has no line break at its end, or lacks the faces of its last vertices.
  void check_end(const ObjStatement& last) {
    const bool has_unused = highest_used_ < positions_.size();
    if (last.has_break && statements_.ends_in_break()) {
      if (has_unused && !faces_.empty())
        warnings_.push_back(fmt::format("no face uses the last vertices of the file, {} to {}; check that the file is complete",
                                        highest_used_ + 1, positions_.size()));
      return;
    }
    const bool is_face = last.keyword == "f" || last.keyword == "fo";
    const bool is_complete = last.has_break || (is_face ? is_complete_face() : is_without_corner_count(last.keyword));
    if (!is_complete || has_unused)
      throw InputError(where_,
                       fmt::format("ends within its last line{}: the file is truncated",
                                   is_complete ? fmt::format(", and no face uses the vertices from {}", highest_used_ + 1) : ""),
                       "copy or export it again; if it is complete, end its last line with a line break");
    doubts_.emplace_back("the last line has no line break; check that the file is complete");
  }

  static bool is_without_corner_count(std::string_view word) { return word == "l" || word == "p" || word == "s"; }

  /// Of the last statement: three corners at least, all written alike.
  [[nodiscard]] bool is_complete_face() const {
    const auto shape = [](std::string_view word) {
      return std::array<std::size_t, 2>{static_cast<std::size_t>(std::count(word.begin(), word.end(), '/')), word.find("//")};
    };
    const auto written_alike = [&](std::string_view word) {
      const bool both_double = (shape(word)[1] == std::string_view::npos) == (shape(words_[0])[1] == std::string_view::npos);
      return !word.ends_with('/') && shape(word)[0] == shape(words_[0])[0] && both_double;
    };
    return words_.size() >= 3 && std::all_of(words_.begin(), words_.end(), written_alike);
  }

  MeshFile assemble() {
    FaceCutter cutter(where_);
    std::vector<std::uint32_t> face;
    std::unordered_map<std::uint64_t, std::uint32_t> local;
    std::size_t current = std::numeric_limits<std::size_t>::max();
    for (const Face& parsed : faces_) {
      MeshPart& part = parts_[parsed.part];
      if (parsed.part != current) local = {};
      current = parsed.part;
      face.clear();
      for (std::size_t i = parsed.first; i < parsed.first + parsed.count; ++i) {
        Corner corner = corners_[i];
        if (corner.uv >= uvs_.size()) corner.uv = kNoUv;
        const auto key = std::uint64_t{corner.vertex} << 32 | corner.uv;
        const auto [found, is_new] = local.try_emplace(key, static_cast<std::uint32_t>(part.positions.size()));
        if (is_new) add_position(corner, cutter.num_faces(), part);
        face.push_back(found->second);
      }
      cutter.add(face, part);
    }
    if (const std::string warning = cutter.warning(); !warning.empty()) warnings_.push_back(warning);
    if (num_unknown_ > 0)
      warnings_.push_back(
          fmt::format("{} lines start with an unknown word and are ignored (line {}: '{}')", num_unknown_, unknown_line_, unknown_));
    return {std::move(parts_), cutter.num_faces(), std::move(warnings_), std::move(doubts_)};
  }

  void add_position(const Corner& corner, std::uint64_t face, MeshPart& part) const {
    if (corner.vertex >= positions_.size())
      throw InputError(where_,
                       fmt::format("face {} of '{}' uses vertex {}, but there are {} vertices", face, one_line(part.object), corner.vertex,
                                   positions_.size()),
                       "repair the mesh and export it again");
    part.positions.push_back(positions_[corner.vertex]);
    if (!uvs_.empty()) part.uvs.push_back(corner.uv == kNoUv ? glm::vec2(0) : uvs_[corner.uv]);
    if (!colors_.empty()) part.colors.push_back(corner.vertex < colors_.size() ? colors_[corner.vertex] : glm::vec3(1));
  }

  ObjStatements statements_;
  ObjStatement statement_;
  const std::string& where_;
  const ObjOptions& options_;
  std::string object_, material_, part_object_, part_material_;
  std::vector<std::string_view> words_;
  std::vector<glm::dvec3> positions_;
  std::vector<glm::vec3> colors_;
  std::vector<glm::vec2> uvs_;
  std::size_t num_uvs_ = 0, highest_used_ = 0;
  std::vector<Corner> corners_;
  std::vector<Face> faces_;
  std::vector<MeshPart> parts_;
  std::size_t num_unknown_ = 0, unknown_line_ = 0;
  std::string unknown_;
  std::vector<std::string> warnings_, doubts_;
};

}  // namespace

MeshFile parse_obj(std::string_view bytes, const std::string& where, const ObjOptions& options) {
  return ObjParser(bytes, where, options).parse();
}

}  // namespace earshot
