// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <glm/geometric.hpp>
#include <numbers>
#include <string>

#include "envs/hearing/agent_hearing.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "tests/support/acoustics/decay.h"
#include "tests/support/acoustics/rooms.h"

// One test per defect that the predecessor had or its users reported (docs/reference/formats.md, section 6): each would have caught it.
namespace earshot {
namespace {

AcousticConfig quick_config() {
  AcousticConfig config;
  config.rays = 32;
  config.early_candidate_rays = 200;
  config.rir_length_s = 0.25f;
  return config;
}

std::vector<float> render(const AcousticScene& scene, RirSynthesizer& synthesizer, glm::vec3 source, glm::vec3 listener) {
  EnergyResponse response;
  compute_energy_response(scene, EarlyCandidates(scene, source), listener, response);
  Rir rir;
  synthesizer.render(response, 0, 1, rir);
  return rir.samples;
}

RirSynthesizer mono_synthesizer(const AcousticScene& scene) {
  return RirSynthesizer(make_synthesis_tables(scene.config(), scene.bands(), ChannelLayout::mono, nullptr));
}

// Indirect pressure was sqrt(4 pi) too high: DRR 11 dB too low in every room.  Judged on the rendered pressure, the whole chain.
TEST(OriginalDefects, IndirectSoundIsNotRaisedBySqrtFourPi) {
  for (const int source_rays : {0, 512}) {
    AcousticConfig config;
    config.early = config.air_absorption = Switch::off;
    config.rays = 4096;
    config.source_rays = source_rays;
    const AcousticScene scene(rooms::shoe1(0.2, 1), config);
    RirSynthesizer synthesizer = mono_synthesizer(scene);
    const std::vector<float> rir = render(scene, synthesizer, rooms::shoe1_source(), rooms::shoe1_listener());
    double direct = 0, rest = 0;
    for (std::size_t i = 0; i < rir.size(); ++i) {
      // The direct sound comes after 8.06 ms, the first reflection after 11.2 ms.
      (static_cast<double>(i) / config.sample_rate_hz < 9.6e-3 ? direct : rest) += double{rir[i]} * rir[i];
    }
    // O-11: -11.623 dB; with the defect -22.6 dB.  0.5 dB: T60 0.48 s cut at 0.5 s, carriers, 4096 rays.
    EXPECT_NEAR(10 * std::log10(direct / rest), -11.623, 0.5) << source_rays << " source rays";
  }
}

// Materials were off by default, and after a reset the material file was silently not read again.
TEST(OriginalDefects, MaterialsCountInEverySceneThatIsLoaded) {
  SceneCache scenes(quick_config(), {}, "", std::size_t{1} << 30);
  const auto decay_s = [&](const std::string& id) {
    const auto source = scenes.source(id, {1.2f, 0, 1.5f}, 1.1f);
    EnergyResponse response;
    compute_energy_response(source->scene->acoustics, source->candidates, {3.8f, 1.6f, 2.3f}, response);
    return decay::time_s(response.late.band_energy(3), response.late.bin_s(), -3, -13);
  };
  const auto folder = std::filesystem::temp_directory_path() / ("earshot_defects_" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  const auto scene_with =
      [&](const std::string& name, const std::string& absorption) {
        std::ofstream(folder / (name + ".json"))
            << R"({"materials": [{"name": "wall", "labels": ["default"], "source": "a test", "absorption": [1000, )" + absorption +
                   R"(], "scattering": [1000, 0.5]}]})";
        std::ofstream(folder / (name + ".yaml")) << "mesh: shoebox:5x3x4\nmaterials: " + name + ".json\nassign: {\"*\": wall}\n";
        return (folder / (name + ".yaml")).string();
      };
  const double live_s = decay_s(scene_with("live", "0.15")), dead_s = decay_s(scene_with("dead", "0.6")),
               again_s = decay_s(scene_with("again", "0.15"));
  std::filesystem::remove_all(folder);
  EXPECT_EQ(again_s, live_s) << "the third file is read as the first was";
  // Eyring: 0.62 and 0.11 s; the predecessor would have had one value.
  EXPECT_GT(live_s, 3 * dead_s);
}

// Same static pose, four queries: 2244, 2244, 4489, 6793 samples (sound-spaces #127).  Other poses between must not matter either.
TEST(OriginalDefects, ResponseAtOnePoseKeepsItsLengthAndBits) {
  const AcousticScene scene(rooms::shoe1(0.1, 0.3), quick_config());
  const EarlyCandidates candidates(scene, rooms::shoe1_source());
  RirSynthesizer synthesizer = mono_synthesizer(scene);
  EnergyResponse response;  // reused, as an agent does
  Rir rir;
  const auto at = [&](glm::vec3 listener) {
    compute_energy_response(scene, candidates, listener, response);
    synthesizer.render(response, 0, 1, rir);
    return rir.samples;
  };
  const std::vector<float> first = at(rooms::shoe1_listener());
  EXPECT_EQ(first.size(), 4000u);  // 0.25 s at 16 kHz
  for (int query = 0; query < 4; ++query) {
    EXPECT_EQ(at(rooms::point(1.3 + query, 3.1, 1.2)).size(), first.size()) << "a response may not grow into a buffer sized by the first";
    EXPECT_EQ(at(rooms::shoe1_listener()), first) << "query " << query;
  }
}

HearingEngines engines_of(const AcousticConfig& config) {
  const BandLayout bands = BandLayout::octaves(config.sample_rate_hz);
  return HearingEngines(make_synthesis_tables(config, bands, ChannelLayout::binaural, Hrtf::rigid_sphere(config.sample_rate_hz)),
                        {.max_rir_samples = 4000, .max_block_samples = 2400}, {});
}

/// Sound of the first block of an episode.
std::vector<float> first_block(AgentHearing& hearing, HearingEngines& engines, const EnvSource& source, const LibrarySound& clip,
                               const Pose& pose) {
  const PlayedSound played{.source = &source, .sound = &clip};
  hearing.begin(std::span(&played, 1));
  hearing.trace(engines, pose, 1.5f, 2400);
  hearing.synthesize(engines, pose.heading_rad);
  std::vector<float> sound(4800), window(2 * 16000);
  EXPECT_TRUE(hearing.convolve(engines, 2400, sound, window));
  return sound;
}

// The acoustic context was never reset: the first responses of an episode were those of the last one's end, or blended with them.
TEST(OriginalDefects, AnEpisodeDoesNotHearTheLastOne) {
  const AcousticConfig config = quick_config();
  SceneCache scenes(config, {}, "", std::size_t{1} << 30);
  HearingEngines engines = engines_of(config);
  const LibrarySound clip(synthesize_sound("synth:noise", 16000));
  const Pose pose{.position = {2.5f, 0, 2.0f}, .heading_rad = 0.7f};
  // Same pose to the bit, so that nothing but the source or the scene tells the episodes apart.
  const auto here = scenes.source("shoebox:5x3x4@0.2", {1.2f, 0, 1.5f}, 1.5f),
             there = scenes.source("shoebox:5x3x4@0.2", {4.2f, 0, 3.1f}, 1.5f),
             elsewhere = scenes.source("shoebox:5x3x4@0.7", {4.2f, 0, 3.1f}, 1.5f);
  AgentHearing used;
  std::vector<std::vector<float>> heard;
  for (const auto& source : {here, there, elsewhere, here}) {
    AgentHearing fresh;
    heard.push_back(first_block(used, engines, *source, clip, pose));
    EXPECT_EQ(heard.back(), first_block(fresh, engines, *source, clip, pose));
  }
  EXPECT_NE(heard[0], heard[1]);
  EXPECT_NE(heard[1], heard[2]);
  EXPECT_EQ(heard[0], heard[3]);
}

// A sensor key was hard-coded, so a second listener in a scene could not work; here two may even take turns.
TEST(OriginalDefects, TwoListenersInOneSceneDoNotDisturbEachOther) {
  const AcousticConfig config = quick_config();
  SceneCache scenes(config, {}, "", std::size_t{1} << 30);
  HearingEngines engines = engines_of(config);
  const LibrarySound clip(synthesize_sound("synth:noise", 16000));
  const auto source = scenes.source("shoebox:5x3x4@0.2", {1.2f, 0, 1.5f}, 1.5f);
  const Pose first_pose{.position = {2.5f, 0, 2.0f}}, second_pose{.position = {4.1f, 0, 0.9f}, .heading_rad = 2};
  AgentHearing alone, first, second;
  const std::vector<float> expected = first_block(alone, engines, *source, clip, first_pose);
  const PlayedSound played{.source = source.get(), .sound = &clip};
  first.begin(std::span(&played, 1)), second.begin(std::span(&played, 1));
  first.trace(engines, first_pose, 1.5f, 2400), second.trace(engines, second_pose, 1.5f, 2400);
  second.synthesize(engines, second_pose.heading_rad), first.synthesize(engines, first_pose.heading_rad);
  std::vector<float> of_first(4800), of_second(4800), window(2 * 16000);
  EXPECT_TRUE(second.convolve(engines, 2400, of_second, window));
  EXPECT_TRUE(first.convolve(engines, 2400, of_first, window));
  EXPECT_EQ(of_first, expected);
  EXPECT_NE(of_second, expected);
}

// Labels were searched as substrings: `table` in vegetable, `wall` in wallet.
TEST(OriginalDefects, AVegetableIsNotATable) {
  const MaterialDatabase database = MaterialDatabase::from_json(
      R"({"materials": [{"name": "oak", "labels": ["table", "wall"], "absorption": [1000, 0.1], "scattering": [1000, 0.1]},
                        {"name": "other", "labels": ["default"], "absorption": [1000, 0.2], "scattering": [1000, 0.1]}]})",
      "test");
  ASSERT_NE(database.find_label("table"), nullptr);
  EXPECT_EQ(database.find_label("table")->name, "oak");
  for (const char* category : {"vegetable", "tablecloth", "wallet", "drywall", "tables"})
    EXPECT_EQ(database.find_label(category), nullptr) << category;
  const MaterialDatabase builtin = MaterialDatabase::builtin();
  const Material* vegetable = builtin.find_label("vegetable");
  EXPECT_TRUE(vegetable == nullptr || vegetable != builtin.find_label("table"));
}

// There was no seed: the same call gave other responses from run to run (sound-spaces #118).
TEST(OriginalDefects, TheSeedDecidesTheBits) {
  const auto room = rooms::shoe1(0.1, 0.5);
  const auto with_seed = [&](std::uint64_t seed) {
    AcousticConfig config = quick_config();
    config.seed = seed;
    const AcousticScene scene(room, config);
    RirSynthesizer synthesizer = mono_synthesizer(scene);
    return render(scene, synthesizer, rooms::shoe1_source(), rooms::shoe1_listener());
  };
  const std::vector<float> seven = with_seed(7);
  EXPECT_EQ(with_seed(7), seven);
  const std::vector<float> eight = with_seed(8);
  EXPECT_NE(eight, seven);
  // Another estimate of the same room: not silence, not another level (32 rays: 0.6 dB).
  const auto energy = [](const std::vector<float>& rir) {
    double sum = 0;
    for (const float sample : rir) sum += double{sample} * sample;
    return sum;
  };
  EXPECT_NEAR(10 * std::log10(energy(eight) / energy(seven)), 0, 2);
}

// Components 1, 2, 3 of the source position were read in place of 0, 1, 2 (habitat-sim #2316).
TEST(OriginalDefects, EveryComponentOfThePositionsIsRead) {
  const AcousticScene scene(rooms::empty(), quick_config());
  const glm::vec3 listener(1, 2, 3);
  for (const glm::vec3 offset : {glm::vec3(1.5f, 0, 0), glm::vec3(0, 2.5f, 0), glm::vec3(0, 0, -3.5f), glm::vec3(1, -2, 2)}) {
    std::vector<Arrival> arrivals;
    EarlyCandidates(scene, listener + offset).find_arrivals(scene, listener, arrivals);
    ASSERT_EQ(arrivals.size(), 1u);
    EXPECT_NEAR(arrivals[0].distance_m, glm::length(offset), 1e-6f * glm::length(offset));
    EXPECT_LT(glm::length(arrivals[0].direction - glm::normalize(offset)), 1e-6f);
  }
}

// The visibility ray started at the source and looked away from the listener.
TEST(OriginalDefects, AWallBehindTheSourceHidesNothing) {
  const glm::vec3 source(0, 1, 0), listener(4, 1, 0);
  const auto direct_arrives = [&](float wall_x) {
    TriangleMesh mesh;
    rooms::append_quad(mesh, {glm::vec3(wall_x, -5, -5), glm::vec3(wall_x, 5, -5), glm::vec3(wall_x, 5, 5), glm::vec3(wall_x, -5, 5)}, 0);
    AcousticConfig config = quick_config();
    config.early = config.late = config.transmission = config.diffraction = Switch::off;
    const AcousticScene scene(rooms::scene_of(std::move(mesh), {Material::uniform("wall", 0.5f, 0.f)}), config);
    std::vector<Arrival> arrivals;
    EarlyCandidates(scene, source).find_arrivals(scene, listener, arrivals);
    return arrivals.size() == 1;
  };
  EXPECT_TRUE(direct_arrives(-1)) << "behind the source";
  EXPECT_TRUE(direct_arrives(5)) << "behind the listener";
  EXPECT_FALSE(direct_arrives(2)) << "between them";
}

// At each pass of the loop the convolution began anew, so what still rang from the end of the sound was cut: a gap every few seconds.
// Steps, too, must join without one.
TEST(OriginalDefects, ReverberationRunsOnOverTheLoopAndFromStepToStep) {
  constexpr int length = 3000, taps = 2000, block = 700;
  SoundClip clip{.name = "click at the end", .sample_rate_hz = 16000, .samples = std::vector<float>(length, 0.f)};
  clip.samples[length - 1] = 1.f;
  std::vector<float> rir(taps);
  for (int i = 0; i < taps; ++i) rir[i] = static_cast<float>(std::exp(-i / 500.0) * std::cos(0.3 * i));
  StreamConvolver convolver({.max_rir_samples = taps, .max_block_samples = block, .crossfade_samples = 0}, 1);
  StreamPosition position{.sample = 0, .clip_offset = 0, .already_playing = false};
  std::vector<float> sound(block);
  for (int step = 0; step < 14; ++step) {  // three passes, no pass a whole number of steps
    convolver.convolve(clip, position, rir, {}, taps, block, sound);
    for (int i = 0; i < block; ++i) {
      // Samples since the last click; the ones before have died away (2000 taps in a loop of 3000).
      const auto now = static_cast<int>(position.sample) + i;
      const int since = (now + 1) % length, clicks = (now + 1) / length;
      ASSERT_NEAR(sound[i], clicks > 0 && since < taps ? rir[since] : 0.f, 2e-6f) << "sample " << now;
    }
    position.sample += block;
  }
}

}  // namespace
}  // namespace earshot
