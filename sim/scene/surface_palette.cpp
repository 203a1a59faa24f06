// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/surface_palette.h"

#include <array>
#include <glm/common.hpp>

#include "sim/base/files.h"
#include "sim/base/text/text_match.h"

namespace earshot {
namespace {

struct WordColor {
  std::string_view word;
  glm::vec3 srgb;
};

/// The first entry whose word occurs in the name decides: the narrower word stands first.
constexpr std::array<WordColor, 47> kColors{{
    {"tv_glass", {0.06f, 0.06f, 0.08f}},       {"glass", {0.62f, 0.76f, 0.82f}},       {"brick_painted", {0.80f, 0.74f, 0.68f}},
    {"brick", {0.62f, 0.32f, 0.25f}},          {"limestone", {0.78f, 0.74f, 0.64f}},   {"marble", {0.86f, 0.85f, 0.84f}},
    {"terrazzo", {0.72f, 0.69f, 0.66f}},       {"ceramic", {0.84f, 0.89f, 0.91f}},     {"concrete_painted", {0.75f, 0.78f, 0.78f}},
    {"concrete_block", {0.60f, 0.60f, 0.58f}}, {"ceiling", {0.93f, 0.93f, 0.91f}},     {"parquet", {0.70f, 0.50f, 0.30f}},
    {"wood_floor", {0.66f, 0.47f, 0.29f}},     {"linoleum", {0.48f, 0.56f, 0.46f}},    {"needle_felt", {0.40f, 0.42f, 0.47f}},
    {"carpet_heavy", {0.45f, 0.26f, 0.28f}},   {"carpet_loop", {0.50f, 0.47f, 0.40f}}, {"carpet_tufted", {0.55f, 0.45f, 0.42f}},
    {"carpet", {0.47f, 0.44f, 0.52f}},         {"rug", {0.55f, 0.20f, 0.22f}},         {"concrete", {0.58f, 0.58f, 0.57f}},
    {"bookshelf", {0.50f, 0.28f, 0.20f}},      {"door", {0.55f, 0.38f, 0.24f}},        {"wood_panelling", {0.58f, 0.40f, 0.25f}},
    {"plywood", {0.78f, 0.63f, 0.44f}},        {"wooden", {0.60f, 0.40f, 0.23f}},      {"wood", {0.57f, 0.39f, 0.24f}},
    {"upholstery", {0.24f, 0.37f, 0.52f}},     {"leather", {0.36f, 0.20f, 0.14f}},     {"plastic", {0.85f, 0.55f, 0.20f}},
    {"theatre", {0.52f, 0.12f, 0.16f}},        {"audience", {0.45f, 0.40f, 0.42f}},    {"curtain", {0.60f, 0.28f, 0.38f}},
    {"blinds", {0.82f, 0.80f, 0.74f}},         {"steel", {0.63f, 0.66f, 0.69f}},       {"plant", {0.25f, 0.47f, 0.20f}},
    {"grass", {0.33f, 0.52f, 0.22f}},          {"water", {0.16f, 0.36f, 0.48f}},       {"gypsum", {0.88f, 0.85f, 0.78f}},
    {"plaster", {0.86f, 0.84f, 0.79f}},        {"lime_wash", {0.92f, 0.91f, 0.86f}},   {"foam", {0.30f, 0.30f, 0.32f}},
    {"wool", {0.74f, 0.70f, 0.55f}},           {"soil", {0.36f, 0.27f, 0.19f}},        {"gravel", {0.55f, 0.53f, 0.50f}},
    {"snow", {0.93f, 0.95f, 0.97f}},           {"default", {0.70f, 0.70f, 0.68f}},
}};

float unit_of(std::uint64_t hash, unsigned byte) { return static_cast<float>(hash >> (8 * byte) & 0xFFu) / 255.f; }

}  // namespace

glm::vec3 palette_color(std::string_view material, std::string_view object) {
  const std::string name = fold_case(material);
  const std::uint64_t name_hash = hash64(name);
  glm::vec3 color = glm::vec3(0.45f) + 0.45f * glm::vec3(unit_of(name_hash, 0), unit_of(name_hash, 1), unit_of(name_hash, 2));
  for (const WordColor& entry : kColors) {
    if (name.find(entry.word) == std::string::npos) continue;
    color = entry.srgb;
    break;
  }
  const float brightness = 1.f + 0.08f * (2.f * unit_of(hash64(object), 0) - 1.f);
  return glm::clamp(brightness * color, 0.f, 1.f);
}

}  // namespace earshot
