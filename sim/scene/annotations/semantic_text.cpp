// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/annotations/semantic_text.h"

#include <fmt/format.h>

#include <charconv>
#include <optional>

#include "sim/base/errors.h"
#include "sim/scene/readers/text_scanner.h"

namespace earshot {
namespace {

constexpr std::string_view kHead = "HM3D Semantic Annotations";

std::optional<std::uint32_t> parse_hex_color(std::string_view text) {
  std::uint32_t color = 0;
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, color, 16);
  if (text.size() != 6 || error != std::errc() || stop != end) return std::nullopt;
  return color;
}

struct Instance {
  std::int64_t id;
  std::uint32_t color;
  std::string category;
};

/// nullopt where the line is not `id,RRGGBB,"category",region`.
std::optional<Instance> parse_instance(std::string_view line) {
  const std::size_t first = line.find(','), second = line.find(',', first + 1);
  if (first == std::string_view::npos || second == std::string_view::npos) return std::nullopt;
  const std::size_t opening = second + 1, closing = line.rfind('"');
  if (opening >= line.size() || line[opening] != '"' || closing <= opening || line.substr(closing + 1, 1) != ",") return std::nullopt;
  const std::optional<std::int64_t> id = parse_whole(trimmed(line.substr(0, first)));
  const std::optional<std::uint32_t> color = parse_hex_color(trimmed(line.substr(first + 1, second - first - 1)));
  if (!id || !color || !parse_whole(trimmed(line.substr(closing + 2)))) return std::nullopt;
  return Instance{*id, *color, std::string(line.substr(opening + 1, closing - opening - 1))};
}

}  // namespace

Annotations parse_semantic_text(std::string_view text, const std::string& where) {
  Annotations annotations(where);
  LineScanner lines(text);
  if (!lines.next() || trimmed(lines.line()) != kHead)
    throw InputError(where, fmt::format("does not begin with '{}'", kHead), "copy the file again");
  while (lines.next()) {
    const std::string_view line = trimmed(lines.line());
    if (line.empty()) continue;
    std::optional<Instance> instance = parse_instance(line);
    if (!instance)
      throw InputError(fmt::format("{}:{}", where, lines.number()), "is not an instance of HM3D: id,RRGGBB,\"category\",region",
                       "copy the file again");
    annotations.add(instance->id, std::move(instance->category), instance->color);
  }
  return annotations;
}

}  // namespace earshot
