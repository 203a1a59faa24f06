// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/readers/obj_materials.h"

#include <array>
#include <set>
#include <vector>

#include "sim/base/files.h"
#include "sim/base/text/text_match.h"
#include "sim/scene/readers/text_scanner.h"

namespace earshot {
namespace {

/// The file of map_Kd: the text after its options; the name may contain blanks.
std::string texture_file(std::string_view rest) {
  for (;;) {
    rest = trimmed(rest);
    if (!rest.starts_with('-')) return std::string(rest);
    const std::string option = fold_case(std::string(take_word(rest)));
    const bool is_vector = option == "-o" || option == "-s" || option == "-t";
    const std::size_t most = is_vector ? 3 : option == "-mm" ? 2 : 1;
    for (std::size_t taken = 0; taken < most; ++taken) {
      std::string_view after = rest;
      const std::string_view value = take_word(after);
      if (is_vector && !parse_decimal(value)) break;  // one to three numbers
      rest = after;
    }
  }
}

bool is_file(const std::filesystem::path& path) {
  std::error_code error;
  return std::filesystem::is_regular_file(path, error);
}

}  // namespace

std::string_view obj_name(std::string_view rest) {
  for (std::size_t at = rest.find('#'); at != std::string_view::npos; at = rest.find('#', at + 1)) {
    const bool blank_before = at == 0 || line_blanks.find(rest[at - 1]) != std::string_view::npos;
    const bool blank_behind = at + 1 == rest.size() || line_blanks.find(rest[at + 1]) != std::string_view::npos;
    if (blank_before && blank_behind) return trimmed(rest.substr(0, at));
  }
  return trimmed(rest);
}

void parse_mtl(std::string_view text, std::map<std::string, ObjLook, std::less<>>& looks) {
  ObjLook* look = nullptr;
  for (LineScanner lines(text); lines.next();) {
    std::string_view rest = lines.line();
    const std::string keyword = fold_case(std::string(take_word(rest)));
    if (keyword == "newmtl") {
      look = &looks[std::string(obj_name(rest))];
    } else if (look != nullptr && keyword == "kd") {
      std::array<std::optional<double>, 3> rgb;
      for (auto& value : rgb) value = parse_decimal(take_word(rest));
      if (rgb[0] && rgb[1] && rgb[2]) look->base_color = glm::vec3(*rgb[0], *rgb[1], *rgb[2]);
    } else if (look != nullptr && keyword == "map_kd") {
      look->texture = texture_file(rest);
    }
  }
}

ObjLibraries find_obj_libraries(std::string_view obj, const std::filesystem::path& path) {
  const std::filesystem::path default_library = std::filesystem::path(path).replace_extension(".mtl");
  ObjLibraries libraries;
  std::set<std::filesystem::path> seen;
  const auto add = [&](std::vector<std::filesystem::path>& list, std::filesystem::path file) {
    if (seen.insert(file).second) list.push_back(std::move(file));
  };
  const auto add_named = [&](const std::filesystem::path& file) {
    const bool is_there = is_file(file);
    add(is_there ? libraries.found : libraries.missing, file);
    if (!is_there && is_file(default_library)) add(libraries.found, default_library);
  };
  for (LineScanner lines(obj); lines.next();) {
    std::string_view rest = lines.line();
    if (take_word(rest) != "mtllib" || trimmed(rest).empty()) continue;
    const std::filesystem::path whole = path.parent_path() / std::string(trimmed(rest));
    if (is_file(whole)) {
      add(libraries.found, whole);
    } else {
      for (std::string_view name = take_word(rest); !name.empty(); name = take_word(rest))
        add_named(path.parent_path() / std::string(name));
    }
  }
  return libraries;
}

std::map<std::string, ObjLook, std::less<>> read_obj_looks(std::string_view obj, const std::filesystem::path& path) {
  std::map<std::string, ObjLook, std::less<>> looks;
  for (const std::filesystem::path& library : find_obj_libraries(obj, path).found) parse_mtl(read_file(library), looks);
  return looks;
}

}  // namespace earshot
