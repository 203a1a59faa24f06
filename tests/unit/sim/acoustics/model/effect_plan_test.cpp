// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/effect_plan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/effect_scenes.h"

namespace earshot {
namespace {

using effects::decision;
using effects::material;
using rooms::point;
using testing::HasSubstr;

AcousticConfig automatic_length() {
  AcousticConfig config;
  config.rir_length_s = 0;
  return config;
}

/// Bits of a response with one effect automatic and forced on.
template <class Field>
void expect_exact_skip(const effects::EffectScene& where, Field field, const std::string& effect) {
  AcousticConfig config;
  AcousticConfig forced = config;
  forced.*field = Switch::on;
  const AcousticScene scene(where.scene, config);
  const EffectDecision* decided = decision(scene, effect);
  ASSERT_NE(decided, nullptr);
  EXPECT_FALSE(decided->on) << where.name;
  EXPECT_EQ(decided->kind, BoundKind::exact) << where.name;
  EXPECT_EQ(decided->change, 0) << where.name;
  for (const glm::vec3 listener : where.listeners) {
    EXPECT_TRUE(effects::same_bits(effects::render(where.scene, config, where.source, listener),
                                   effects::render(where.scene, forced, where.source, listener)))
        << where.name << " " << effect;
  }
}

TEST(EffectPlan, NoEdgeInTheAirNoDiffraction) {
  for (const auto& scene : {effects::box_scene(), effects::closet_scene(), effects::hall_scene()}) {
    expect_exact_skip(scene, &AcousticConfig::diffraction, "diffraction");
    // The boxes have outer edges: it is the plan that leaves them out.
    AcousticConfig forced;
    forced.diffraction = Switch::on;
    EXPECT_FALSE(AcousticScene(scene.scene, AcousticConfig{}).plan().diffraction) << scene.name;
    EXPECT_TRUE(AcousticScene(scene.scene, forced).plan().diffraction) << scene.name;
  }
}

TEST(EffectPlan, AnEdgeInARoomThatNoPointIsInKeepsDiffractionOn) {
  // Beside a hall of 30 x 20 x 4 m a closed closet of 1.2 x 1.2 x 2.2 m with a screen across most of it.
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {30, 20, 4}, 0);
  rooms::append_box(mesh, {30.5, 9, 0}, {31.7, 10.2, 2.2}, 0);
  rooms::append_quad(mesh, {point(31.1, 9, 0), point(31.1, 9.8, 0), point(31.1, 9.8, 2.2), point(31.1, 9, 2.2)}, 0);
  const AcousticScene scene(rooms::scene_of(std::move(mesh), {material(0.2, 0.3)}), AcousticConfig{});
  EXPECT_TRUE(scene.plan().diffraction);
  const EnergyResponse response = effects::render(scene, EarlyCandidates(scene, point(30.8, 9.2, 1.2)), point(31.4, 9.2, 1.2));
  EXPECT_TRUE(std::ranges::any_of(response.arrivals, [](const Arrival& a) { return a.kind == ArrivalKind::diffraction; }));
}

TEST(EffectPlan, OpaqueWallsNoTransmission) {
  for (const auto& scene : {effects::box_scene(), effects::two_rooms_scene(0.9, 0), effects::open_field_scene(), effects::canyon_scene()})
    expect_exact_skip(scene, &AcousticConfig::transmission, "transmission");
}

TEST(EffectPlan, NoMirrorsNoImagePaths) {
  expect_exact_skip({"matt", rooms::shoe1(0.2, 1), rooms::shoe1_source(), {rooms::shoe1_listener()}}, &AcousticConfig::early, "early");
}

TEST(EffectPlan, NothingComesBackNoLateField) {
  for (const auto& room : {rooms::shoe1(1, 1), rooms::empty()}) {
    const AcousticScene scene(room, AcousticConfig{});
    EXPECT_EQ(scene.config().late, Switch::off);
    expect_exact_skip({"silent", room, rooms::shoe1_source(), {rooms::shoe1_listener()}}, &AcousticConfig::late, "late");
  }
  // Hardly anything reflects: late stays.  1e-3 of the energy of a wall is -30 dB, above the -45 dB that the plan promises.
  EXPECT_TRUE(AcousticScene(rooms::shoe1(0.999, 1), AcousticConfig{}).plan().late);
}

TEST(EffectPlan, LateIsOnInALiveCloset) {
  // a = 0.02 in a closet: 16 pi r^2 / A with A = 0.23 m2, r = 0.54 m: 18 dB above the direct sound.
  const auto closet = effects::closet_scene();
  const AcousticScene scene(closet.scene, automatic_length());
  EXPECT_TRUE(scene.plan().late);
  const EnergyResponse response = effects::render(scene, EarlyCandidates(scene, closet.source), closet.listeners[0]);
  const RoomMetrics metrics = measure(scene, response);
  EXPECT_LT(*metrics.bands[1].drr_db, -14);
}

TEST(EffectPlan, AirIsOnInAHallAndOffInLowBandsOfAShortResponse) {
  // Lambert hall, a = 0.15: T = 3.077 s without air, 1.079 s with it in the octave of 8 kHz, 3.054 s in that of 125 Hz
  // (docs/evidence/oracles.md, O-16).
  const auto hall = effects::hall_scene();
  AcousticConfig config = automatic_length();
  config.rays = 512;
  config.sample_rate_hz = 24000;  // all of the octave of 8 kHz
  const AcousticScene scene(hall.scene, config);
  EXPECT_NEAR(scene.config().rir_length_s, 3.16, 0.4) << "50 dB in 2.54 s, a fifth more, and the way of 0.11 s";
  const EnergyResponse response = effects::render(scene, EarlyCandidates(scene, hall.source), hall.listeners[0]);
  config.air_absorption = Switch::off;
  const AcousticScene dry_scene(hall.scene, config);
  const EnergyResponse dry = effects::render(dry_scene, EarlyCandidates(dry_scene, hall.source), hall.listeners[0]);
  EXPECT_NEAR(*measure(scene, response).bands[6].t30_s, 1.0789, 0.03 * 1.0789);
  EXPECT_NEAR(*measure(dry_scene, dry).bands[6].t30_s, 3.0771, 0.03 * 3.0771);
  // Half of the octave is left at 16 kHz: 1 / (1 / 3.0771 + a c / 60) with a = 0.07594 dB/m at 6707 Hz, c = 343.2 m/s.
  config.air_absorption = Switch::automatic;
  config.sample_rate_hz = 16000;
  const AcousticScene clipped_scene(hall.scene, config);
  const EnergyResponse clipped = effects::render(clipped_scene, EarlyCandidates(clipped_scene, hall.source), hall.listeners[0]);
  EXPECT_NEAR(*measure(clipped_scene, clipped).bands[6].t30_s, 1.3170, 0.03 * 1.3170);

  // 0.5 s, 171.6 m: 4.4535e-4 dB/m at 125.9 Hz are 0.0764 dB, at 250 Hz 0.225 dB (docs/explanation/effect_bounds.md, section 2); RT60 of a
  // box with 0.2 is far below the 4.0 s from where 1 % of it is lost.
  const AcousticScene short_scene(effects::box_scene().scene, AcousticConfig{});
  EXPECT_FALSE(short_scene.plan().air[0]);
  for (std::size_t band = 1; band < 7; ++band) EXPECT_TRUE(short_scene.plan().air[band]);
  EXPECT_EQ(short_scene.air_energy_per_m()[0], 0.f);
  EXPECT_NEAR(decision(short_scene, "air_absorption_low")->change, 0.0764, 0.0002);
  // RT60 in 125 Hz of a hall of 3.08 s changes by 0.76 %, within 1 %; that of a livelier one by more.
  EXPECT_FALSE(AcousticScene(hall.scene, AcousticConfig{}).plan().air[0]);
  EXPECT_TRUE(AcousticScene(rooms::box(30, 20, 12, rooms::uniform_walls(0.1, 1), 1, Air{}), AcousticConfig{}).plan().air[0])
      << "4.69 s: 1.2 % of RT60";
}

// A line where a material is given at 63 Hz, with the change of its reflections; none where values of 125 Hz are held.
TEST(EffectPlan, NamesTheLowOctaveWhereMaterialsKnowIt) {
  EXPECT_EQ(decision(AcousticScene(effects::box_scene().scene, AcousticConfig{}), "low_octave"), nullptr);
  for (std::uint32_t draw = 0; draw < 10; ++draw) {
    const RandomStream random(38, Purpose::test, 24, draw);
    const float at_63 = 0.9f * random.uniform(0), at_125 = 0.9f * random.uniform(1);
    Material wall = Material::uniform("wall", 0.1f, 0.f);
    // Flat over each of the two octaves, so that the means are the values.
    wall.absorption = {.hz = {88.f, 90.f}, .value = {at_63, at_125}};
    std::array<Material, 6> walls;
    walls.fill(wall);
    const auto room = rooms::box(6, 5, 3, walls);
    const double change_db = std::abs(10 * std::log10((1 - double{at_63}) / (1 - double{at_125})));
    const AcousticScene usual(room, AcousticConfig{});
    const EffectDecision* left_out = decision(usual, "low_octave");
    ASSERT_EQ(left_out != nullptr, change_db > 0.1) << at_63 << " " << at_125;
    if (left_out != nullptr) {
      EXPECT_FALSE(left_out->on);
      EXPECT_NEAR(left_out->change, change_db, 0.05 + 0.05 * change_db);  // 88 to 90 Hz straddle the edge
    }
    AcousticConfig config;
    config.low_octave = true;
    const AcousticScene low(room, config);
    EXPECT_TRUE(decision(low, "low_octave")->on);
    ASSERT_EQ(low.num_bands(), usual.num_bands() + 1);
    EXPECT_EQ(low.padded_bands(), usual.padded_bands());
    EXPECT_NEAR(low.reflectance(0)[0], 1.f - at_63, 0.03f);
    EXPECT_EQ(low.reflectance(0)[1], usual.reflectance(0)[0]);
    EXPECT_NE(low.hash(), usual.hash());
  }
}

TEST(EffectPlan, AirThatIsOffKeepsTheBudgetDownTo45dB) {
  // Common random numbers, so that all of the difference is the air's.
  double largest_db = 0;
  for (const auto& where : {effects::box_scene(), effects::two_rooms_scene(0.9, 0), effects::closet_scene()}) {
    AcousticConfig config;
    config.rays = 64;
    AcousticConfig forced = config;
    forced.air_absorption = Switch::on;
    const AcousticScene scene(where.scene, config), in_full(where.scene, forced);
    const EffectDecision* low = decision(scene, "air_absorption_low");
    if (low == nullptr) continue;
    for (const glm::vec3 listener : where.listeners) {
      const EnergyResponse response = effects::render(scene, EarlyCandidates(scene, where.source), listener),
                           full = effects::render(in_full, EarlyCandidates(in_full, where.source), listener);
      const effects::Change change = effects::compare(scene, response, in_full, full);
      EXPECT_LE(change.edc_db, kEffectBudgetDb) << where.name;
      EXPECT_LE(change.energy_db, kEffectBudgetDb) << where.name;
      EXPECT_LE(change.t30_percent, 100 * kEffectBudgetRt) << where.name;
      largest_db = std::max(largest_db, change.edc_db);
    }
  }
  EXPECT_GT(largest_db, 0) << "nothing was off";
}

TEST(EffectPlan, WhatChangesATailBelow35dBIsSeen) {
  // The comparison that the plan is judged by: half a decibel more from -38 dB on, and an end at -43 dB.
  const auto where = effects::box_scene();
  AcousticConfig config;
  config.rays = 256;
  config.bands = 1;
  const AcousticScene scene(where.scene, config);
  const EnergyResponse response = effects::render(scene, EarlyCandidates(scene, where.source), where.listeners[0]);
  std::vector<double> left = effects::series(response, 0, response.late.num_bins());
  energy_decay_curve(std::vector<double>(left), left);
  const auto with_tail = [&](double from_db, float factor) {
    EnergyResponse changed = response;
    const std::size_t of_bin = changed.late.values().size() / left.size();
    for (std::size_t i = 0; i < changed.late.values().size(); ++i)
      if (effects::db(left[i / of_bin] / left[0]) < from_db) changed.late.values()[i] *= factor;
    return changed;
  };
  ASSERT_LT(effects::db(left.back() / left[0]), -46) << "the record must reach that far";
  const EnergyResponse louder = with_tail(-38, 1.122f), ended = with_tail(-43, 0.f);
  EXPECT_NEAR(effects::compare(scene, response, scene, louder).edc_db, 0.5, 0.02);
  EXPECT_TRUE(std::isinf(effects::compare(scene, response, scene, ended).edc_db));
  EXPECT_TRUE(std::isinf(effects::compare(scene, ended, scene, response).edc_db));
  EXPECT_EQ(effects::compare(scene, response, scene, response).edc_db, 0);
}

TEST(EffectPlan, TransmissionIsTracedWhereWallsAreTheOnlyWay) {
  const auto closed = effects::two_rooms_scene(0, 0.01);
  const AcousticScene scene(closed.scene, AcousticConfig{});
  EXPECT_TRUE(scene.plan().straight_transmission);
  EXPECT_TRUE(scene.plan().traced_transmission);
  ASSERT_NE(decision(scene, "transmission_late"), nullptr);
  EXPECT_TRUE(std::isinf(decision(scene, "transmission_late")->change));
  const EarlyCandidates candidates(scene, closed.source);
  const EnergyResponse beyond = effects::render(scene, candidates, closed.listeners[1]);
  EXPECT_GT(rooms::total_energy(beyond.late), 0);
  AcousticConfig off;
  off.transmission = Switch::off;
  const EnergyResponse silent = effects::render(closed.scene, off, closed.source, closed.listeners[1]);
  EXPECT_EQ(rooms::total_energy(silent.late), 0);
  EXPECT_TRUE(silent.arrivals.empty());
}

TEST(EffectPlan, WallsWithNothingBehindAreNotTraced) {
  std::array<Material, 6> walls;
  walls.fill(material(0.2, 0.3, 0.1));
  const AcousticScene scene(rooms::box(5, 4, 3, walls), AcousticConfig{});
  EXPECT_FALSE(scene.plan().traced_transmission);
  EXPECT_EQ(decision(scene, "transmission_late")->change, 0);
  // A partition that lets through a millionth beside an open door.
  EXPECT_FALSE(AcousticScene(effects::two_rooms_scene(0.9, 1e-6).scene, AcousticConfig{}).plan().traced_transmission);
  EXPECT_EQ(decision(AcousticScene(effects::two_rooms_scene(0.9, 1e-6).scene, AcousticConfig{}), "transmission_late")->kind,
            BoundKind::bounded);
}

TEST(EffectPlan, DiffractionIsOnBehindACorner) {
  // Half a metre behind the end of a screen, source in front of it, in the open: nothing else gets there.
  TriangleMesh mesh;
  rooms::append_quad(mesh, {point(0, 0, 0), point(0, 3, 0), point(0, 3, 3), point(0, 0, 3)}, 0);
  const auto screen = rooms::scene_of(std::move(mesh), {material(0.2, 0.1)});
  const AcousticScene scene(screen, AcousticConfig{});
  EXPECT_TRUE(decision(scene, "diffraction")->on);
  const EnergyResponse response = effects::render(scene, EarlyCandidates(scene, point(-2, 2, 1.5)), point(0.5, 2.5, 1.5));
  const auto diffracted = std::count_if(response.arrivals.begin(), response.arrivals.end(),
                                        [](const Arrival& a) { return a.kind == ArrivalKind::diffraction; });
  EXPECT_GE(diffracted, 1);
  EXPECT_EQ(response.effects.diffraction_skipped, 0u);
}

TEST(EffectPlan, LengthFollowsTheDecay) {
  // Lambert box 5 x 4 x 3 m without air, a = 0.2: the exact time constant of O-10; 50 dB take 5/6 of T60, plus a fifth, plus the way.
  // The slowest of 32 points decides: up to 12 %; 20 ms for the first segment, 10 ms of rounding.
  AcousticConfig config = automatic_length();
  config.air_absorption = Switch::off;
  for (const auto& [absorption, rt60_s] : {std::pair{0.1, 0.99755}, std::pair{0.2, 0.48135}, std::pair{0.5, 0.1661}}) {
    const AcousticScene scene(rooms::shoe1(absorption, 1), config);
    const double way_s = std::sqrt(50.0) / 343.0;
    EXPECT_NEAR(scene.config().rir_length_s, 1.2 * 5 / 6 * rt60_s + way_s, 0.12 * rt60_s + 0.03) << absorption;
  }
  EXPECT_EQ(AcousticScene(rooms::shoe1(0.001, 1), config).config().rir_length_s, 4.f) << "at most";
  EXPECT_EQ(AcousticScene(rooms::shoe1(0, 1), config).config().rir_length_s, 4.f) << "nothing is lost";
  EXPECT_EQ(AcousticScene(rooms::empty(), config).config().rir_length_s, 0.1f) << "at least";
  EXPECT_EQ(AcousticScene(rooms::shoe1(0.1, 1), AcousticConfig{}).config().rir_length_s, 0.5f) << "as configured";
}

TEST(EffectPlan, LengthReadsAuto) {
  const auto read_from = [](const std::string& yaml) {
    ConfigReader reader = ConfigReader::from_text(yaml, "test.yaml");
    AcousticConfig config;
    read(reader, config);
    reader.finish();
    validate(config);
    return config.rir_length_s;
  };
  EXPECT_EQ(read_from("{rir_length_s: auto}"), 0.f);
  EXPECT_EQ(read_from("{rir_length_s: 0}"), 0.f);
  EXPECT_EQ(read_from("{rir_length_s: 0.7}"), 0.7f);
  EXPECT_EQ(read_from("{rays: 3}"), 0.5f);
  for (const char* bad : {"{rir_length_s: long}", "{rir_length_s: -1}", "{rir_length_s: 61}"})
    EXPECT_THROW(read_from(bad), InputError) << bad;
}

TEST(EffectPlan, DoesNotDependOnSeedFewRaysOrThreads) {
  const auto scene = effects::two_rooms_scene(0.9, 0.01).scene;
  AcousticConfig config = automatic_length();
  const AcousticScene first(scene, config);
  config.seed = 77;
  config.rays = 300;
  config.threads = 2;
  const AcousticScene second(scene, config);
  EXPECT_EQ(first.config().rir_length_s, second.config().rir_length_s);
  EXPECT_EQ(first.plan().air, second.plan().air);
  EXPECT_EQ(first.plan().field, second.plan().field);
  EXPECT_EQ(decision(first, "transmission_late")->change, decision(second, "transmission_late")->change);
  EXPECT_EQ(first.plan().traced_transmission, second.plan().traced_transmission);
  EXPECT_EQ(first.with_rays(300, 77).hash(), second.hash());
}

TEST(EffectPlan, FieldWhereManyRaysWouldBeNeeded) {
  // In one room ten rays do; where more are configured for each pose, photons are the cheaper way there too.  Not in the open.
  AcousticConfig ten;
  ten.rays = 10;
  EXPECT_FALSE(uses_source_field(AcousticScene(effects::box_scene().scene, ten)));
  EXPECT_TRUE(uses_source_field(AcousticScene(effects::box_scene().scene, AcousticConfig{})));
  for (const auto& scene : {effects::open_field_scene(), effects::canyon_scene()})
    EXPECT_FALSE(uses_source_field(AcousticScene(scene.scene, AcousticConfig{}))) << scene.name;
  const auto house = effects::apartment_scene().scene;
  const auto field = [&](auto change) {
    AcousticConfig config;
    change(config);
    return uses_source_field(AcousticScene(house, config));
  };
  EXPECT_TRUE(field([](AcousticConfig&) {}));
  EXPECT_FALSE(field([](AcousticConfig& c) { c.field = Switch::off; }));
  EXPECT_TRUE(field([](AcousticConfig& c) { c.transmission = Switch::on; }));
  EXPECT_FALSE(field([](AcousticConfig& c) { c.source_rays = 64; }));
  EXPECT_FALSE(field([](AcousticConfig& c) { c.specular_exponent = 10; }));
  EXPECT_FALSE(field([](AcousticConfig& c) { c.late = Switch::off; }));
  EXPECT_TRUE(field([](AcousticConfig& c) { c.scattering = 0; }));
  EXPECT_TRUE(field([](AcousticConfig& c) { c.field = Switch::on, c.source_rays = 64; }));
  EXPECT_THROW(field([](AcousticConfig& c) { c.field = Switch::on, c.specular_exponent = 10; }), InputError);
  // Photons pass walls where walls matter; few rays at each pose do not.
  AcousticConfig few;
  EXPECT_TRUE(AcousticScene(house, few).plan().traced_transmission);
  few.field = Switch::off;
  EXPECT_FALSE(AcousticScene(house, few).plan().traced_transmission);
  few.rays = 512;
  EXPECT_TRUE(AcousticScene(house, few).plan().traced_transmission);
  AcousticConfig forced;
  forced.field = Switch::on;
  EXPECT_TRUE(uses_source_field(AcousticScene(effects::box_scene().scene, forced)));
}

TEST(EffectPlan, SwitchesForceAndForbid) {
  const auto where = effects::two_rooms_scene(0.9, 0.01);
  for (const auto& [effect, field] : {std::pair{"air_absorption", &AcousticConfig::air_absorption},
                                      std::pair{"early", &AcousticConfig::early}, std::pair{"diffraction", &AcousticConfig::diffraction},
                                      std::pair{"late", &AcousticConfig::late}, std::pair{"transmission", &AcousticConfig::transmission}}) {
    for (const Switch choice : {Switch::on, Switch::off}) {
      AcousticConfig config;
      config.*field = choice;
      const AcousticScene scene(where.scene, config);
      ASSERT_NE(decision(scene, effect), nullptr) << effect;
      EXPECT_EQ(decision(scene, effect)->on, choice == Switch::on) << effect;
      EXPECT_EQ(decision(scene, effect)->kind, BoundKind::user_set) << effect;
    }
  }
}

TEST(EffectPlan, EveryDecisionSaysWhatItRestsOn) {
  for (const auto& where : effects::all_scenes()) {
    const AcousticScene scene(where.scene, automatic_length());
    for (const char* effect : {"direct", "early", "late", "diffraction", "transmission", "air_absorption", "rir_length_s", "field"})
      EXPECT_NE(decision(scene, effect), nullptr) << where.name << " " << effect;
    for (const EffectDecision& d : scene.plan().decisions) {
      EXPECT_FALSE(d.decision.empty()) << d.effect;
      if (d.on || d.kind == BoundKind::user_set) continue;
      EXPECT_GE(d.change, 0) << where.name << " " << d.effect;
      EXPECT_FALSE(d.unit.empty()) << d.effect;
      // Off within the budget, or the number of what is given up.
      if (d.kind == BoundKind::bounded && d.unit == "dB") {
        EXPECT_LE(d.change, kEffectBudgetDb) << where.name << " " << d.effect;
      }
      if (d.kind == BoundKind::exact) {
        EXPECT_EQ(d.change, 0) << where.name << " " << d.effect;
      }
    }
  }
}

// What walls near a pose add has no bound: sharp edges have more than the corner of right angles that the line names.
TEST(EffectPlan, WallsNearAPoseAreApproximated) {
  for (int number = 0; number < 10; ++number) {
    const AcousticScene scene(rooms::box(4 + 0.3 * number, 4, 3, rooms::uniform_walls(0.1 + 0.05 * number, 0.3)), AcousticConfig{});
    ASSERT_NE(decision(scene, "wall_power"), nullptr);
    EXPECT_EQ(decision(scene, "wall_power")->kind, BoundKind::approximated);
    EXPECT_NEAR(decision(scene, "wall_power")->change, 9.03, 0.01);
  }
}

}  // namespace
}  // namespace earshot
