// SPDX-License-Identifier: Apache-2.0
// The public scene, source and response against the engine below them: the same bits, and the same refusals.
#include "earshot/scene.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <set>
#include <stop_token>

#include "earshot/audio.h"
#include "sim/acoustics/core/acoustic_config.h"
#include "sim/acoustics/metrics/band_metric_keys.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/synthesis/carriers.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/base/random.h"
#include "sim/scene/scene.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::HasSubstr;

/// A room, a source, a listener and a heading, drawn at random.
struct DrawnPose {
  std::string scene;
  glm::dvec3 source, listener;
  double heading_deg;

  explicit DrawnPose(std::uint32_t number) {
    const RandomStream random(71, Purpose::episode, number);
    const auto within = [&](double low, double high, std::uint32_t draw) {
      return low + (high - low) * static_cast<double>(random.uniform(draw));
    };
    const double x = within(3, 9, 0), y = within(2.4, 4, 1), z = within(3, 8, 2);
    scene = fmt::format("shoebox:{:.2f}x{:.2f}x{:.2f}@{:.2f}", x, y, z, within(0.1, 0.6, 3));
    source = {within(0.5, x - 0.5, 4), within(0.5, y - 0.5, 5), within(0.5, z - 0.5, 6)};
    listener = {within(0.5, x - 0.5, 7), within(0.5, y - 0.5, 8), within(0.5, z - 0.5, 9)};
    heading_deg = within(-180, 180, 10);
  }
};

api::Vec3 vec3(glm::dvec3 v) { return {v.x, v.y, v.z}; }
api::SceneOptions short_fast() { return {.preset = "fast", .settings = {{"rir_length_s", 0.25}}}; }

/// The response of a pose by the engine's own types.
struct EngineResponse {
  std::shared_ptr<const Scene> scene;
  AcousticScene acoustics;
  EarlyCandidates candidates;
  EnergyResponse response;

  explicit EngineResponse(const DrawnPose& pose, int sh_order)
      : scene(std::make_shared<const Scene>(load_scene(pose.scene))),
        acoustics(scene, config_of(sh_order)),
        candidates(acoustics, SoundSource{scene->to_local(pose.source)}) {
    compute_energy_response(acoustics, candidates, scene->to_local(pose.listener), response);
  }
  static AcousticConfig config_of(int sh_order) {
    AcousticConfig config = acoustic_preset("fast");
    config.rir_length_s = 0.25f;
    config.sh_order = sh_order;
    return config;
  }
  [[nodiscard]] Rir render(const DrawnPose& pose, const std::string& channels) const {
    RirSynthesizer synthesizer(make_synthesis_tables(acoustics.config(), acoustics.bands(), ListenerLayout::named(channels), nullptr));
    Rir rir;
    synthesizer.render(response, pose.heading_deg * std::numbers::pi / 180,
                       {carrier_key(acoustics.hash(), candidates.source()), scene->to_local(pose.listener)}, rir);
    return rir;
  }
};

TEST(ApiScene, ResponsesHaveTheBitsOfTheEngine) {
  for (std::uint32_t number = 0; number < 6; ++number) {
    const DrawnPose pose(number);
    const api::Source source = api::Scene(pose.scene, short_fast()).source(vec3(pose.source));
    for (const auto& [channels, sh_order] : {std::pair<std::string, int>{"mono", 0}, {"binaural", 1}, {"ambisonic:2", 2}}) {
      const EngineResponse engine(pose, sh_order);
      const Rir expected = engine.render(pose, channels);
      const api::Rir rir = source.render(vec3(pose.listener), {.heading_deg = pose.heading_deg, .channels = channels});
      EXPECT_EQ(rir.num_channels, expected.num_channels);
      EXPECT_EQ(rir.num_samples, expected.num_samples);
      EXPECT_EQ(rir.sample_rate_hz, static_cast<double>(expected.sample_rate_hz));
      EXPECT_EQ(rir.samples, expected.samples) << pose.scene << " " << channels;
      EXPECT_EQ(source.response(vec3(pose.listener), channels).render({.heading_deg = pose.heading_deg}).samples, expected.samples);
    }
  }
}

TEST(ApiScene, ManyListenersHaveTheBitsOfEachAloneOnAnyNumberOfThreads) {
  const DrawnPose pose(20);
  const api::Source source = api::Scene(pose.scene, short_fast()).source(vec3(pose.source));
  std::vector<api::Listener> listeners;
  for (int i = 0; i < 9; ++i)
    listeners.push_back({.position = {0.5 + 0.2 * i, 1.2, 1 + 0.1 * i}, .heading_deg = 40.0 * i, .pitch_deg = 5.0 * i});
  const auto rirs = source.render_all(listeners, {.channels = "binaural", .threads = 1});
  const auto again = source.render_all(listeners, {.channels = "binaural", .threads = 3});
  for (std::size_t i = 0; i < listeners.size(); ++i) {
    EXPECT_EQ(rirs[i].samples, again[i].samples);
    EXPECT_EQ(rirs[i].samples,
              source.render(listeners[i].position, {.heading_deg = listeners[i].heading_deg, .pitch_deg = listeners[i].pitch_deg}).samples);
  }
}

TEST(ApiScene, PathsLateEnergyAndMetricsAreThoseOfTheEngine) {
  const DrawnPose pose(30);
  const EngineResponse engine(pose, 1);
  const api::Response response = api::Scene(pose.scene, short_fast()).source(vec3(pose.source)).response(vec3(pose.listener));
  ASSERT_EQ(response.arrivals().size(), engine.response.arrivals.size());
  for (std::size_t i = 0; i < response.arrivals().size(); ++i) {
    const api::Arrival& arrival = response.arrivals()[i];
    const Arrival& expected = engine.response.arrivals[i];
    EXPECT_EQ(static_cast<int>(arrival.kind), static_cast<int>(expected.kind));
    EXPECT_EQ(arrival.identity, expected.identity);
    EXPECT_EQ(arrival.distance_m, static_cast<double>(expected.distance_m));
    ASSERT_EQ(arrival.amplitude.size(), static_cast<std::size_t>(engine.acoustics.num_bands()));
    for (std::size_t band = 0; band < arrival.amplitude.size(); ++band) EXPECT_EQ(arrival.amplitude[band], expected.amplitude[band]);
  }
  // The direct sound travels in a straight line at the speed of sound: closed form.
  const double distance_m = glm::length(pose.listener - pose.source);
  EXPECT_EQ(response.arrivals()[0].kind, api::ArrivalKind::direct);
  EXPECT_NEAR(response.arrivals()[0].delay_s, distance_m / response.speed_of_sound_m_per_s(), 1e-6);

  const api::LateEnergy late = response.late();
  EXPECT_TRUE(std::ranges::equal(late.values, engine.response.late.values()));
  EXPECT_EQ(late.energy(7, 2), engine.response.late.energy(7, 2));

  const api::Metrics metrics = response.metrics();
  const RoomMetrics expected = measure(engine.acoustics, engine.response);
  ASSERT_EQ(metrics.bands_hz.size(), expected.bands.size());
  ASSERT_EQ(api::metric_fields().size(), kBandMetricKeys.size());
  for (std::size_t field = 0; field < kBandMetricKeys.size(); ++field)
    for (std::size_t band = 0; band < expected.bands.size(); ++band) {
      const auto value = expected.bands[band].*kBandMetricKeys[field].value;
      const double found = (metrics.*api::metric_fields()[field].values)[band];
      if (value) {
        EXPECT_EQ(found, *value) << kBandMetricKeys[field].key;
      } else {
        EXPECT_TRUE(std::isnan(found)) << kBandMetricKeys[field].key;
      }
    }
  EXPECT_EQ(metrics.drr_db, expected.drr_db.value());
}

TEST(ApiScene, CopiesShareAndOutliveTheFirst) {
  const DrawnPose pose(40);
  api::Rir expected;
  std::optional<api::Response> response;
  std::span<const float> amplitude;
  {
    const api::Scene scene(pose.scene, short_fast());
    const api::Source source = api::Scene(scene).source(vec3(pose.source));
    response = source.response(vec3(pose.listener));
    expected = source.render(vec3(pose.listener));
    amplitude = response->arrivals()[0].amplitude;
  }
  const api::Response copy = *response;
  response.reset();
  EXPECT_EQ(copy.render().samples, expected.samples);
  EXPECT_GT(amplitude[0], 0.f);
}

TEST(ApiScene, OptionsReachTheEngine) {
  const api::Scene scene("shoebox:5x3x4@0.2",
                         {.preset = "fast", .settings = {{"rir_length_s", 0.5}, {"bands", 4}}, .rate_hz = 24000, .seed = 9});
  EXPECT_EQ(scene.sample_rate_hz(), 24000);
  EXPECT_EQ(scene.seed(), 9u);
  EXPECT_EQ(scene.rir_length_s(), 0.5);
  EXPECT_EQ(scene.bands_hz().size(), 4u);
  EXPECT_EQ(scene.num_triangles(), 12u);
  EXPECT_EQ(scene.hash(), load_scene("shoebox:5x3x4@0.2").hash());
  EXPECT_EQ(scene.bounds().upper, (api::Vec3{5, 3, 4}));
  std::set<std::string> effects;
  for (const api::EffectDecision& line : scene.plan()) effects.insert(line.effect);
  EXPECT_TRUE(effects.contains("diffraction"));
}

TEST(ApiScene, RandomPositionsAreFreeAndTheFirstOnesDoNotDependOnTheCount) {
  const api::Scene scene("house:7", {.preset = "fast"});
  const auto few = scene.random_positions(3, {.height_m = 1.2, .seed = 4}), many = scene.random_positions(6, {.height_m = 1.2, .seed = 4});
  EXPECT_TRUE(std::equal(few.begin(), few.end(), many.begin()));
  EXPECT_NE(scene.random_positions(1, {.seed = 5})[0], few[0]);
  EXPECT_GT(scene.source(few[0]).render(few[1], {.channels = "mono"}).num_samples, 0);
}

template <class Call>
std::string refusal_of(const Call& call) {
  return message_of<InputError>(call);
}

TEST(ApiScene, WrongInputIsRefusedInOneLine) {
  const auto open = [](const std::string& spec, const api::SceneOptions& options = {}) {
    return refusal_of([&] { api::Scene(spec, options); });
  };
  EXPECT_THAT(open("no_such_file.glb"), HasSubstr("no_such_file.glb"));
  EXPECT_THAT(open("shoebox:5x3"), HasSubstr("shoebox:5x3"));
  EXPECT_THAT(open("shoebox:5x3x4", {.preset = "superb"}), HasSubstr("superb"));
  EXPECT_THAT(open("shoebox:5x3x4", {.settings = {{"ray", 100}}}), HasSubstr("ray"));
  EXPECT_THAT(open("shoebox:5x3x4", {.settings = {{"early_order", 9}}}), HasSubstr("early_order"));
  EXPECT_THAT(open("shoebox:5x3x4", {.rate_hz = 100}), HasSubstr("sample_rate_hz"));
  EXPECT_THAT(open("shoebox:5x3x4", {.up = "x"}), HasSubstr("up"));

  const api::Scene scene("shoebox:5x3x4@0.2", short_fast());
  const api::Source source = scene.source({1, 1, 1});
  EXPECT_THAT(refusal_of([&] { (void)scene.source({1, 1, 1}, {.pattern = "loud"}); }), HasSubstr("loud"));
  EXPECT_THAT(refusal_of([&] { (void)scene.source({1, 1, 1}, {.radius_m = 11}); }), HasSubstr("radius_m = 11"));
  EXPECT_THAT(refusal_of([&] { (void)scene.source({NAN, 1, 1}); }), HasSubstr("position"));
  EXPECT_THAT(refusal_of([&] { (void)source.render({50, 1, 1}); }), HasSubstr("listener"));
  EXPECT_THAT(refusal_of([&] { (void)source.render({1, INFINITY, 1}); }), HasSubstr("listener"));
  EXPECT_THAT(refusal_of([&] { (void)source.render({2, 1, 1}, {.heading_deg = NAN}); }), HasSubstr("heading_deg"));
  EXPECT_THAT(refusal_of([&] { (void)source.render({2, 1, 1}, {.channels = "surround_9_1"}); }), HasSubstr("surround_9_1"));
  EXPECT_THAT(refusal_of([&] { (void)source.render({2, 1, 1}, {.channels = "mono", .hrtf = "head.sofa"}); }), HasSubstr("hrtf"));
  EXPECT_THAT(refusal_of([&] { (void)source.response({2, 1, 1}, "mono").render({.channels = "binaural"}); }), HasSubstr("harmonics"));
  EXPECT_THAT(refusal_of([&] { (void)source.plan_accuracy("t20=5%", {}); }), HasSubstr("listeners"));
  EXPECT_THAT(refusal_of([&] { (void)scene.random_positions(-1); }), HasSubstr("count = -1"));
  EXPECT_THAT(refusal_of([&] { (void)api::measure({}); }), HasSubstr("rir"));
  EXPECT_THAT(refusal_of([&] { (void)api::measure({1, 2, 0, {1, 0}}); }), HasSubstr("sample_rate_hz"));
}

TEST(ApiScene, SectionOfABoxIsItsOutline) {
  for (std::uint32_t number = 0; number < 8; ++number) {
    const RandomStream random(72, Purpose::episode, number);
    const double x = 3 + 6 * static_cast<double>(random.uniform(0)), y = 2.5 + 2 * static_cast<double>(random.uniform(1)),
                 z = 3 + 6 * static_cast<double>(random.uniform(2));
    const double at = y * (0.1 + 0.8 * static_cast<double>(random.uniform(3)));
    const api::Scene scene(fmt::format("shoebox:{:.3f}x{:.3f}x{:.3f}", x, y, z));
    double length_m = 0;
    for (const auto& [a, b] : scene.section(at)) {
      EXPECT_NEAR(a.y, at, 1e-9);
      length_m += std::hypot(b.x - a.x, b.z - a.z);
    }
    EXPECT_NEAR(length_m, 2 * (x + z), 0.01);  // sizes are written with three digits
    EXPECT_THAT(scene.section(y + 1), testing::IsEmpty());
  }
  EXPECT_THROW((void)api::Scene("shoebox:3x3x3").section(NAN), InputError);
}

TEST(ApiScene, ARequestToStopEndsACallAndTheNextOneIsWhole) {
  const api::Source source = api::Scene("shoebox:6x3x5", short_fast()).source({2, 1.5, 2});
  const std::vector<api::Listener> listeners(40, {.position = {4, 1.5, 2}});
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW((void)source.render_all(listeners, {.threads = 2, .stop = stop.get_token()}), RunError);
  EXPECT_EQ(source.render_all(listeners, {.threads = 2}).size(), listeners.size());
  EXPECT_THROW((void)source.render_all(listeners, {.threads = -1}), InputError);
}

TEST(ApiScene, AResultFollowsFromTheArgumentsOfItsCallAlone) {
  const api::Scene scene("house:1,rooms=3,area_m2=36",
                         {.preset = "fast", .settings = {{"rir_length_s", 0.1}, {"rays", 2048}, {"field_photons", 20'000}}});
  const std::vector<api::Vec3> places = scene.random_positions(301, {.seed = 3});
  std::vector<api::Listener> listeners;
  for (std::size_t i = 1; i < places.size(); ++i) listeners.push_back({.position = places[i]});
  const api::Source fresh = scene.source(places[0]), used = scene.source(places[0]);
  const api::Rir alone = fresh.render(places[1]);
  const std::vector<api::Rir> all = used.render_all(listeners);
  ASSERT_NE(all[0].samples, alone.samples) << "the large call takes no field: the test shows nothing";
  EXPECT_EQ(used.render(places[1]).samples, alone.samples);
  EXPECT_EQ(used.render_all(listeners)[0].samples, all[0].samples);
  EXPECT_EQ(fresh.render_all(listeners)[0].samples, all[0].samples);
}

TEST(ApiScene, DirectSoundOfASilentRoomIsThatOfTheOpenField) {
  // Walls that absorb all: pressure 1 / (4 pi r) at time r / c.
  const api::Scene scene("shoebox:8x4x8@1", {.preset = "fast", .settings = {{"air_absorption", false}}});
  const api::Response response = scene.source({2, 2, 4}).response({6, 2, 4}, "mono");
  for (const float amplitude : response.arrivals()[0].amplitude) EXPECT_NEAR(amplitude, 1 / (16 * std::numbers::pi), 1e-6);
  const api::Metrics measured = api::measure(response.render(), response.arrivals()[0].delay_s);
  EXPECT_TRUE(std::isnan(measured.t30_s[4]) || measured.t30_s[4] < 0.1);  // 1 kHz: 63 Hz is the first
}

}  // namespace
}  // namespace earshot
