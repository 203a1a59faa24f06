// SPDX-License-Identifier: Apache-2.0
// Pictures of a batch by EGL, on Mesa's software device or EARSHOT_TEST_EGL_DEVICE; skipped without it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <stdexcept>
#include <utility>

#include "envs/sensors/sensor_rows.h"
#include "sim/base/errors.h"
#include "sim/vision/egl_renderer.h"
#include "tests/support/envs/tested_egl_device.h"
#include "tests/support/envs/vector_semantics.h"

namespace earshot {
namespace {

/// The bytes of one sensor of one env.
std::vector<std::byte> bytes_of(const BatchedEnv& env, std::string_view name, int row, bool last = false) {
  return row_of(last ? env.final_rows(name) : env.rows(name), env.num_envs(), row);
}

class EglEnv : public VectorSemantics {
 protected:
  void SetUp() override {
    try {
      const EglRenderer renderer({.device = tested_egl_device()});
    } catch (const InputError&) {
      GTEST_SKIP() << "this machine has no such device of EGL";
    }
    embree_ = config_;
    config_.observation.renderer = Renderer::egl;
    config_.observation.egl_device = tested_egl_device();
  }
  EnvConfig embree_;
};

/// Pixels of both renderers that agree, over all that were compared.
struct Agreement {
  double agreeing = 0, pixels = 0;
  void add(bool agrees) {
    agreeing += agrees ? 1 : 0;
    ++pixels;
  }
  [[nodiscard]] double fraction() const { return agreeing / pixels; }
};

// The same poses, without noise: 99.9 % of the pixels, as the renderers themselves are held to (EglAgreement).
TEST_F(EglEnv, RowsAgreeWithThoseOfEmbree) {
  for (EnvConfig* config : {&config_, &embree_}) {
    config->observation.depth_noise = false;
    config->observation.camera.width_px = config->observation.camera.height_px = 64;
  }
  BatchedEnv egl = make(6, config_), embree = make(6, embree_);
  egl.reset();
  embree.reset();
  Agreement depth, rgb;
  int ends = 0;
  for (int i = 0; i < 60; ++i) {
    step(egl, i);
    step(embree, i);
    for (int row = 0; row < 6; ++row) {
      const auto at = static_cast<std::size_t>(row);
      ASSERT_EQ(egl.terminated()[at], embree.terminated()[at]);
      const bool ended = egl.terminated()[at] || egl.truncated()[at];
      ends += ended ? 1 : 0;
      for (const bool last : {false, true}) {
        if (last && !ended) continue;
        const auto a = bytes_of(egl, "depth", row, last), b = bytes_of(embree, "depth", row, last);
        const auto x = as_floats(a), y = as_floats(b);
        for (std::size_t p = 0; p < x.size(); ++p) depth.add(std::fabs(x[p] - y[p]) <= 1e-3f * y[p]);
        const auto c = bytes_of(egl, "rgb", row, last), d = bytes_of(embree, "rgb", row, last);
        for (std::size_t p = 0; p < c.size(); p += 3)
          rgb.add(std::ranges::all_of(std::array{p, p + 1, p + 2}, [&](std::size_t byte) {
            return std::abs(std::to_integer<int>(c[byte]) - std::to_integer<int>(d[byte])) <= 2;
          }));
      }
      // What EGL does not draw has the same bits.
      for (const char* name : {"spectrogram", "pointgoal", "around_depth", "around_normals"})
        ASSERT_EQ(bytes_of(egl, name, row), bytes_of(embree, name, row)) << name;
    }
  }
  EXPECT_GT(ends, 20);
  EXPECT_GE(depth.fraction(), 0.999);
  EXPECT_GE(rgb.fraction(), 0.999);
  RecordProperty("depth_agreement", std::to_string(depth.fraction()));
  RecordProperty("rgb_agreement", std::to_string(rgb.fraction()));
}

// All sensors, noise and a panorama by Embree among them.
TEST_F(EglEnv, ThreadsSplitsAndSendingChangeNoBit) {
  constexpr int kEnvs = 5, kSteps = 24;
  BatchedEnv lockstep = make(kEnvs, config_);
  lockstep.reset();
  std::vector<std::vector<std::vector<std::byte>>> expected(kEnvs);
  int ends = 0;
  for (int i = 0; i < kSteps; ++i) {
    step(lockstep, i);
    for (int row = 0; row < kEnvs; ++row) expected[static_cast<std::size_t>(row)].push_back(shown(lockstep, row));
    ends += static_cast<int>(lockstep.finished().size());
  }
  EXPECT_GT(ends, 4);
  for (const int threads : {2, 8}) {
    EnvConfig config = config_;
    config.threads = threads;
    BatchedEnv first(config, set_, scenes_, 2, 0, kEnvs), second(config, set_, scenes_, 3, 2, kEnvs);
    first.reset();
    second.reset();
    for (int i = 0; i < kSteps; ++i) {
      step(first, i);
      second.step(std::vector<std::int32_t>{test_action(2, i), test_action(3, i), test_action(4, i)});
      for (int row = 0; row < kEnvs; ++row)
        ASSERT_EQ(row < 2 ? shown(first, row) : shown(second, row - 2),
                  expected[static_cast<std::size_t>(row)][static_cast<std::size_t>(i)])
            << threads << " threads, env " << row << ", step " << i;
    }
    for (const RecvOrder order : {RecvOrder::as_ready, RecvOrder::as_sent}) {
      BatchedEnv env = make(kEnvs, config);
      env.reset();
      std::vector<int> done(kEnvs, 0);
      std::vector<std::int32_t> ready{0, 1, 2, 3, 4};
      std::size_t under_way = 0;
      while (true) {
        std::vector<std::int32_t> send, actions;
        for (const std::int32_t row : ready)
          if (done[static_cast<std::size_t>(row)] < kSteps) {
            send.push_back(row);
            actions.push_back(test_action(row, done[static_cast<std::size_t>(row)]));
          }
        env.send(send, actions);
        under_way += send.size();
        if (under_way == 0) break;
        const auto got = env.recv(std::min(2, static_cast<int>(under_way)), order);
        ready.assign(got.begin(), got.end());
        under_way -= got.size();
        for (const std::int32_t row : ready) {
          const auto i = static_cast<std::size_t>(row);
          ASSERT_EQ(shown(env, row), expected[i][static_cast<std::size_t>(done[i]++)]) << row;
        }
      }
    }
  }
}

TEST_F(EglEnv, SnapshotsGoOnWithTheSameBits) {
  for (const Autoreset mode : {Autoreset::same_step, Autoreset::next_step}) {
    EnvConfig config = config_;
    config.autoreset = mode;
    BatchedEnv a = make(3, config), b = make(2, config);
    a.reset();
    b.reset();
    for (int i = 0; i < 30; ++i) {
      step(a, i);
      b.restore(1, a.snapshot(2));
      for (std::size_t sensor = 0; sensor < a.sensors().size(); ++sensor)
        ASSERT_EQ(row_of(a.rows(a.sensors()[sensor].name), 3, 2), row_of(b.rows(b.sensors()[sensor].name), 2, 1))
            << i << " " << a.sensors()[sensor].name;
    }
    EXPECT_GT(a.agent(2).episode_count, 0);
  }
}

// The row after an end is the next episode's first picture with `same_step`, and the last one with `next_step`.
TEST_F(EglEnv, AutoresetModesShowTheSamePictures) {
  EnvConfig next_step = config_;
  next_step.autoreset = Autoreset::next_step;
  BatchedEnv a = make(1, config_), b = make(1, next_step);
  a.reset();
  b.reset();
  int ends = 0;
  for (int i = 0; i < 60; ++i) {
    const std::vector<std::int32_t> action{test_action(0, i)};
    a.step(action);
    b.step(action);
    if (a.terminated()[0] || a.truncated()[0]) {
      ++ends;
      for (const char* name : {"depth", "rgb", "semantic"}) {
        EXPECT_EQ(bytes_of(a, name, 0, true), bytes_of(b, name, 0)) << name;
        EXPECT_EQ(bytes_of(b, name, 0, true), bytes_of(b, name, 0)) << name;
      }
      b.step(std::vector<std::int32_t>{0});
    }
    for (const char* name : {"depth", "rgb", "semantic"}) ASSERT_EQ(bytes_of(a, name, 0), bytes_of(b, name, 0)) << name << " " << i;
  }
  EXPECT_GT(ends, 3);
}

// A fault after the pictures were asked for: its rows are zero, not the pictures that the task wanted.
TEST_F(EglEnv, AFaultyEpisodeShowsNoPicture) {
  BatchedEnv env = make(2, config_);
  bool armed = false;
  env.set_stage_hook([&](const StageOutput& output, std::span<float> values) {
    if (output.kind == Fault::pointgoal && output.env == 1 && armed) {
      armed = false;
      values[0] = NAN;
    }
  });
  env.reset();
  step(env, 0);
  armed = true;
  step(env, 1);
  ASSERT_TRUE(env.quarantined()[1]);
  for (const char* name : {"depth", "rgb"}) {
    EXPECT_THAT(bytes_of(env, name, 1, true), testing::Each(std::byte{0})) << name;
    EXPECT_THAT(bytes_of(env, name, 1), testing::Contains(testing::Ne(std::byte{0}))) << name;  // of the next episode
  }
  EXPECT_TRUE(buffers_are_finite(env));
}

// What the driver cannot draw Embree draws, from that step on: the run goes on with the pictures of the other renderer.
TEST_F(EglEnv, AFailureOfTheDriverLeavesThePicturesToEmbree) {
  for (const bool by_exception : {false, true}) {
    BatchedEnv env = make(3, config_), embree = make(3, embree_);
    bool armed = false;
    env.set_stage_hook([&](const StageOutput& output, std::span<float> values) {
      // A panorama's depth comes from a task; a pinhole's has the size of the main camera.
      if (output.kind != Fault::depth || output.env != 2 || values.size() != 16 * 16 || !std::exchange(armed, false)) return;
      if (by_exception) throw std::runtime_error("the driver fell over");
      values[7] = NAN;
    });
    env.reset();
    embree.reset();
    int index = 0;
    const auto both = [&] {
      step(env, index);
      step(embree, index);
      ++index;
    };
    for (int i = 0; i < 3; ++i) both();
    armed = true;
    both();
    ASSERT_FALSE(armed);
    for (int i = 0; i < 20; ++i, both())
      for (int row = 0; row < 3; ++row)
        for (const char* name : {"depth", "rgb", "semantic", "spectrogram"})
          ASSERT_EQ(bytes_of(env, name, row), bytes_of(embree, name, row)) << name << " " << row << " " << index;
    EXPECT_EQ(env.quarantine_counters().total(), 0u);  // where a task had drawn it, the fault would be one of the episode
  }
}

TEST_F(EglEnv, AutoLeavesSoftwareAloneAndADeviceThatIsNotThereIsRefused) {
  EnvConfig config = embree_;
  config.observation.renderer = Renderer::automatic;
  bool hardware = true;
  try {
    const EglRenderer renderer({.device = "auto"});
  } catch (const InputError&) {
    hardware = false;
  }
  if (!hardware) {
    BatchedEnv automatic = make(2, config), embree = make(2, embree_);
    automatic.reset();
    embree.reset();
    for (int row = 0; row < 2; ++row) EXPECT_EQ(shown(automatic, row), shown(embree, row));
    config.observation.renderer = Renderer::egl;
    EXPECT_THROW(make(1, config), InputError);
  }
  for (const Renderer renderer : {Renderer::egl, Renderer::automatic}) {
    config.observation.renderer = renderer;
    config.observation.egl_device = "99";
    EXPECT_THROW(make(1, config), InputError);
  }
}

}  // namespace
}  // namespace earshot
