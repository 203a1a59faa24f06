// SPDX-License-Identifier: Apache-2.0
#include "sim/vision/agent_body.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <set>
#include <vector>

#include "sim/base/random.h"
#include "sim/scene/appearance.h"
#include "sim/scene/color.h"
#include "sim/vision/embree_camera.h"

namespace earshot {
namespace {

// The nearest of many points along the ray that lie in the cylinder.
TEST(AgentBody, HitsAreWhereARayEntersTheCylinder) {
  const AgentBody body{.foot = {1.f, 0.2f, -2.f}, .radius_m = 0.3f, .height_m = 1.4f};
  const auto inside = [&](glm::dvec3 p) {
    const glm::dvec3 q = p - glm::dvec3(body.foot);
    return std::hypot(q.x, q.z) < body.radius_m && q.y > 0 && q.y < body.height_m;
  };
  int hits = 0, misses = 0;
  for (std::uint32_t ray = 0; ray < 400; ++ray) {
    const RandomStream random(1, Purpose::test, ray);
    const glm::vec3 origin(4 * random.uniform(0) - 1, 3 * random.uniform(1) - 1, -4 * random.uniform(2));
    const glm::vec3 toward(1 + 0.5f * (random.uniform(3) - 0.5f), 0.9f + 1.8f * (random.uniform(4) - 0.5f), -2 + random.uniform(5) - 0.5f);
    const glm::vec3 direction = glm::normalize(toward - origin);
    if (inside(origin)) continue;
    constexpr double kStepM = 1e-3;
    double entered_m = -1;
    for (double t = 0; t < 8 && entered_m < 0; t += kStepM)
      if (inside(glm::dvec3(origin) + t * glm::dvec3(direction))) entered_m = t;
    const BodyHit hit = intersect(body, origin, direction);
    if (entered_m < 0) {
      // The march steps over chords shorter than its step.
      if (hit.valid()) {
        EXPECT_FALSE(inside(glm::dvec3(origin) + (double{hit.distance_m} + 2 * kStepM) * glm::dvec3(direction)));
      }
      ++misses;
      continue;
    }
    ++hits;
    ASSERT_TRUE(hit.valid()) << ray;
    EXPECT_NEAR(hit.distance_m, entered_m, 1.01 * kStepM) << ray;
    EXPECT_NEAR(glm::length(hit.normal), 1.f, 1e-5f);
    EXPECT_LT(glm::dot(hit.normal, direction), 0.f);
  }
  EXPECT_GT(hits, 100);
  EXPECT_GT(misses, 20);
  // From inside: the far side.
  const BodyHit out = intersect(body, body.foot + glm::vec3(0, 0.5f, 0), {1, 0, 0});
  EXPECT_NEAR(out.distance_m, 0.3f, 1e-6f);
  EXPECT_NEAR(out.normal.x, -1.f, 1e-6f);
  // Along the axis: the caps.
  EXPECT_NEAR(intersect(body, body.foot + glm::vec3(0.1f, 3.f, 0), {0, -1, 0}).distance_m, 1.6f, 1e-6f);
  EXPECT_FALSE(intersect(body, body.foot + glm::vec3(0.31f, 3.f, 0), {0, -1, 0}).valid());
}

TEST(AgentBody, FirstColoursDiffer) {
  std::set<std::array<std::uint8_t, 3>> colors;
  for (int agent = 0; agent < 16; ++agent) {
    const glm::vec3 color = body_color(agent);
    for (int channel = 0; channel < 3; ++channel) {
      EXPECT_GE(color[channel], 0.f);
      EXPECT_LE(color[channel], 1.f);
    }
    colors.insert(to_srgb8(color));
  }
  EXPECT_EQ(colors.size(), 16u);
}

class BodiesInPictures : public testing::Test {
 protected:
  static constexpr int kSide = 64;
  struct Pictures {
    std::vector<float> depth = std::vector<float>(kSide * kSide), normals = std::vector<float>(3 * kSide * kSide);
    std::vector<std::uint8_t> rgb = std::vector<std::uint8_t>(3 * kSide * kSide);
    std::vector<std::uint16_t> semantic = std::vector<std::uint16_t>(kSide * kSide);
  };
  Pictures look(const Pose& pose, std::span<const AgentBody> bodies, Projection projection = Projection::pinhole) {
    const CameraSensorConfig config{.width_px = kSide, .height_px = kSide, .projection = projection, .unlit = true};
    Pictures seen;
    EmbreeCamera(config).render(scene_, appearance_.get(), pose,
                                {.depth = seen.depth, .rgb = seen.rgb, .semantic = seen.semantic, .normals = seen.normals}, bodies);
    // Depth has the same bits whatever else is wanted.
    std::vector<float> alone(seen.depth.size());
    EmbreeCamera(config).render(scene_, nullptr, pose, {.depth = alone}, bodies);
    EXPECT_EQ(alone, seen.depth);
    return seen;
  }
  Scene scene_ = load_scene("shoebox:8x3x8@0.3");
  std::shared_ptr<const Appearance> appearance_ = load_appearance(scene_);
  const Pose pose_{.position = {4, 0, 7}, .heading_rad = 0};  // looks along -z
};

// Every pixel against the closed form of a vertical cylinder straight ahead: a ray with slope s to the side meets it where
// (t s)^2 + (t - d)^2 = r^2 in the plane of the floor, and depth is t.
TEST_F(BodiesInPictures, DepthIsThatOfACylinderStraightAhead) {
  const AgentBody body{.foot = {4, 0, 4}, .radius_m = 0.4f, .height_m = 1.5f, .color = body_color(1)};
  const Pictures with = look(pose_, std::span(&body, 1)), without = look(pose_, {});
  constexpr double kAwayM = 3, kRadiusM = 0.4, kEyeM = 1.25;
  int on_side = 0;
  for (int row = 0; row < kSide; ++row)
    for (int column = 0; column < kSide; ++column) {
      const std::size_t pixel = static_cast<std::size_t>(row * kSide + column);
      const double right = (column + 0.5 - kSide / 2.0) / (kSide / 2.0), up = (kSide / 2.0 - row - 0.5) / (kSide / 2.0);
      const double discriminant = kAwayM * kAwayM - (1 + right * right) * (kAwayM * kAwayM - kRadiusM * kRadiusM);
      const double t = (kAwayM - std::sqrt(std::max(0.0, discriminant))) / (1 + right * right), height = kEyeM + t * up;
      if (discriminant > 1e-3 && height > 1e-3 && height < 1.5 - 1e-3) {
        ++on_side;
        ASSERT_NEAR(with.depth[pixel], t / 10, 1e-6) << row << " " << column;
        ASSERT_EQ(with.semantic[pixel], agent_category());
        const glm::dvec3 normal((t * right) / kRadiusM, 0, (kAwayM - t) / kRadiusM);  // x right, y up, z back
        for (int axis = 0; axis < 3; ++axis) ASSERT_NEAR(with.normals[3 * pixel + static_cast<std::size_t>(axis)], normal[axis], 1e-5);
        const auto rgb = to_srgb8(body.color);
        ASSERT_TRUE(std::equal(rgb.begin(), rgb.end(), with.rgb.begin() + static_cast<std::ptrdiff_t>(3 * pixel)));
      } else if (discriminant < -1e-3) {
        ASSERT_EQ(with.depth[pixel], without.depth[pixel]);
        ASSERT_EQ(with.semantic[pixel], without.semantic[pixel]);
      }
    }
  EXPECT_GT(on_side, 100);
  EXPECT_EQ(std::ranges::count(without.semantic, agent_category()), 0);
  EXPECT_EQ(category_names()[agent_category()], "agent");
}

TEST_F(BodiesInPictures, PanoramasHaveTheDistanceAlongTheRay) {
  const AgentBody body{.foot = {4, 0, 4}, .radius_m = 0.4f};
  const Pictures seen = look(pose_, std::span(&body, 1), Projection::equirectangular);
  const std::size_t middle = kSide / 2 * kSide + kSide / 2;
  EXPECT_NEAR(seen.depth[middle], 0.26f, 1e-3f);  // half a pixel (0.7 degrees) aside and down
}

TEST_F(BodiesInPictures, TheNearestOfSeveralIsSeenAndWhatIsBehindIsNot) {
  const std::vector<AgentBody> bodies{{.foot = {4, 0, 3}, .radius_m = 0.4f, .color = body_color(1)},
                                      {.foot = {4, 0, 4}, .radius_m = 0.4f, .color = body_color(2)},
                                      {.foot = {4, 0, 7.8f}, .radius_m = 0.4f, .color = body_color(3)}};  // behind the camera
  const Pictures seen = look(pose_, bodies), one = look(pose_, std::span(bodies).subspan(1, 1));
  EXPECT_EQ(seen.depth, one.depth);
  EXPECT_EQ(seen.rgb, one.rgb);
}

// A wall between them.
TEST(AgentBody, ABodyBehindAWallIsNotSeen) {
  const Scene scene = load_scene("house:2,rooms=2,area_m2=30");
  const CameraSensorConfig config{.width_px = 32, .height_px = 32};
  std::vector<float> with(32 * 32), without(32 * 32);
  int seen = 0, hidden = 0;
  const glm::vec3 eye(1.f, 0.f, 1.f);
  for (int i = 0; i < 64; ++i) {
    const float angle = 0.1f * static_cast<float>(i);
    const Pose pose{.position = eye, .heading_rad = angle};
    const glm::vec3 foot = eye + 4.f * forward_of(angle);
    const AgentBody body{.foot = foot};
    EmbreeCamera(config).render(scene, nullptr, pose, {.depth = with}, std::span(&body, 1));
    EmbreeCamera(config).render(scene, nullptr, pose, {.depth = without});
    // No ray of the picture reaches the body before the scene: nothing of it may show.
    bool free_line = false;
    for (int level = 1; level < 60 && !free_line; ++level)
      for (int side = -8; side <= 8 && !free_line; ++side) {
        const glm::vec3 at =
            foot + glm::vec3(0, 0.025f * static_cast<float>(level), 0) + 0.0125f * static_cast<float>(side) * right_of(angle);
        free_line = !scene.rays().occluded(eye + glm::vec3(0, 1.25f, 0), at - 0.1f * forward_of(angle));
      }
    if (free_line) {
      ++seen;
    } else {
      ++hidden;
      EXPECT_EQ(with, without) << i;
    }
  }
  EXPECT_GT(hidden, 5);
}

}  // namespace
}  // namespace earshot
