// SPDX-License-Identifier: Apache-2.0
#include "evaluation/leaderboard/private_set.h"

#include <fmt/format.h>
#include <sys/random.h>

#include <algorithm>
#include <iterator>
#include <optional>
#include <set>
#include <system_error>
#include <utility>
#include <vector>

#include "envs/config/env_config.h"
#include "envs/config/episode_maker.h"
#include "envs/episodes/name_ranges.h"
#include "evaluation/results/set_digest.h"
#include "evaluation/results/split_overlap.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/process/progress.h"
#include "sim/base/sha256.h"
#include "sim/base/temporary_folder.h"
#include "trainer/run/episode_data.h"

namespace earshot {
namespace {

/// Beyond what configs are written with, and far more of them than could be tried.
constexpr std::uint64_t kMinSeed = 1'000'000'000, kSeedCount = std::uint64_t{1} << 48;
/// Of one scene or sound.
constexpr int kMaxDraws = 20;

/// Where a file is written before it has its name: beside it, so that it can be renamed.
std::filesystem::path folder_of(const std::filesystem::path& file) {
  const std::filesystem::path parent = file.has_parent_path() ? file.parent_path() : ".";
  std::error_code error;
  std::filesystem::create_directories(parent, error);
  if (error) throw RunError(parent.string(), "cannot be created: " + error.message());
  return parent;
}

/// "house:3,rooms=2" with another seed.
std::string other_scene(const std::string& scene, const SecretSeeds& draw) {
  const bool generated = scene.starts_with("house:") || scene.starts_with("floor:");
  if (!generated)
    throw InputError(scene, "is not a generated scene, so a new one cannot be drawn",
                     "write the private set with 'earshot dataset episodes', and publish its SHA-256");
  const std::size_t begin = scene.find(':') + 1, end = std::min(scene.find(',', begin), scene.size());
  return scene.substr(0, begin) + std::to_string(draw()) + scene.substr(end);
}

/// "synth:bird:3" with another seed.
std::string other_sound(const std::string& sound, const SecretSeeds& draw) {
  if (!sound.starts_with("synth:"))
    throw InputError(sound, "is not a synthesized sound, so a new one cannot be drawn",
                     "write the private set with 'earshot dataset episodes', and publish its SHA-256");
  return sound.substr(0, sound.find(':', std::string_view("synth:").size())) + ":" + std::to_string(draw());
}

std::vector<std::string> sounds_of(const EpisodeSet& set) {
  std::set<std::string> sounds;
  for (const Episode& episode : set.episodes) {
    if (!episode.sound.empty()) sounds.insert(episode.sound);
    for (const EpisodeSource& source : episode.sources) sounds.insert(source.sound);
  }
  return {sounds.begin(), sounds.end()};
}

std::vector<std::string> scenes_of(const EpisodeSet& set) {
  std::set<std::string> scenes;
  for (const Episode& episode : set.episodes) scenes.insert(episode.scene_id);
  return {scenes.begin(), scenes.end()};
}

template <class Add>
std::vector<std::string> joined(std::vector<std::string> list, const Add& added) {
  list.insert(list.end(), added.begin(), added.end());
  return list;
}

/// Sounds in the place of those of the public set: those that are heard as they are, others with seeds of their own.
std::vector<std::string> draw_sounds(const Benchmark& benchmark, const SecretSeeds& draw) {
  const RunConfig& run = benchmark.run;
  const auto heard = expand_sounds(benchmark.heard_sounds), tested = expand_sounds(run.eval.sounds);
  const auto known = joined(expand_sounds(run.train.sounds), tested);
  std::vector<std::string> sounds;
  for (const std::string& sound : tested) {
    if (std::ranges::count(heard, sound) > 0) {
      sounds.push_back(sound);
      continue;
    }
    for (int draws = 1;; ++draws) {
      const std::vector<std::string> drawn{other_sound(sound, draw)};
      const auto found = find_sound_overlap(known, drawn, run.env.sound_root);
      if (!found) {
        sounds.push_back(drawn[0]);
        break;
      }
      if (draws == kMaxDraws)
        throw InputError(sound, fmt::format("has no replacement: all {} draws are {} '{}'", draws, found->why, found->trained),
                         "use sounds with more variants");
    }
  }
  return sounds;
}

/// Puts scenes of their own in the place of data.scenes, and returns the episodes of each.
std::vector<std::vector<Episode>> draw_scenes(const Benchmark& benchmark, const SecretSeeds& draw, DataConfig& data) {
  const RunConfig& run = benchmark.run;
  const std::vector<std::string> asked = data.scenes;
  std::vector<int> draws(asked.size(), 0);
  std::vector<std::vector<Episode>> episodes(asked.size());
  EpisodeMaker maker(data, run.env.task, make_scene_cache(run.env));
  Progress progress("private episodes", "scene", asked.size());
  const auto draw_scene = [&](std::size_t i) {
    while (draws[i]++ < kMaxDraws) {
      data.scenes[i] = other_scene(asked[i], draw);
      try {
        episodes[i] = maker.make(data.scenes[i]);
        return;
      } catch (const InputError&) {
        if (draws[i] == kMaxDraws) throw;
      }
    }
    throw InputError(asked[i], fmt::format("has no replacement: none of {} draws fits", kMaxDraws), "use scenes with more variants");
  };
  for (std::size_t i = 0; i < asked.size(); ++i) {
    draw_scene(i);
    progress.update(i + 1);
  }
  const auto known = joined(expand_ranges(run.train.scenes), asked);
  while (const auto found = find_scene_overlap(known, data.scenes, run.env.scene_root))
    draw_scene(static_cast<std::size_t>(std::ranges::find(data.scenes, found->tested) - data.scenes.begin()));
  return episodes;
}

}  // namespace

std::uint64_t secret_seed() {
  std::uint64_t bits = 0;
  if (::getrandom(&bits, sizeof(bits), 0) != sizeof(bits)) throw RunError("getrandom", "returned no random bytes");
  return kMinSeed + bits % kSeedCount;
}

Benchmark with_private_set(const Benchmark& benchmark, const std::filesystem::path& file) {
  if (benchmark.private_sha256.empty())
    throw InputError(benchmark.name, "has no private set: benchmark.private.sha256 is missing",
                     "make one with 'earshot benchmark FILE --make-private SET', and put its SHA-256 into the file");
  const std::string sha256 = digest_of_set(file, benchmark.run.env.scene_root, benchmark.run.env.sound_root);
  if (sha256 != benchmark.private_sha256)
    throw InputError(file.string(),
                     fmt::format("has the SHA-256 {}, but the private set of {} {} has {}", sha256, benchmark.name, benchmark.version,
                                 benchmark.private_sha256),
                     "use the file with the published SHA-256");
  Benchmark extended = benchmark;
  extended.run.eval.file = file.string();
  const EpisodeSet set = load_episode_set(file);
  extended.set_hash = hex64(set.hash);
  extended.content_sha256 = digest_of_content(set, benchmark.run.env.scene_root, benchmark.run.env.sound_root);
  return extended;
}

void check_private_split(const Benchmark& benchmark, const EpisodeSet& private_set) {
  const RunConfig& run = benchmark.run;
  const auto refuse = [&](const SplitOverlap& found, const char* set_name) {
    throw InputError("the private set of " + benchmark.name,
                     fmt::format("has '{}', {} '{}' of {}", found.tested, found.why, found.trained, set_name), "make another private set");
  };
  constexpr const char* kOthers = "the training set or the public test set";
  const auto trained = expand_sounds(run.train.sounds), tested = expand_sounds(run.eval.sounds), own = sounds_of(private_set);
  check_held_out_kinds(benchmark, trained, joined(tested, own));
  const auto heard = expand_sounds(benchmark.heard_sounds);
  std::vector<std::string> fresh;
  std::ranges::copy_if(own, std::back_inserter(fresh), [&](const auto& sound) { return std::ranges::count(heard, sound) == 0; });
  if (const auto found = find_sound_overlap(joined(trained, tested), fresh, run.env.sound_root)) refuse(*found, kOthers);
  const auto scenes = joined(expand_ranges(run.train.scenes), expand_ranges(run.eval.scenes));
  if (const auto found = find_scene_overlap(scenes, scenes_of(private_set), run.env.scene_root)) refuse(*found, kOthers);
}

std::string make_private_set(const Benchmark& benchmark, const std::filesystem::path& file, const SecretSeeds& draw) {
  if (std::filesystem::exists(file)) throw InputError(file.string(), "already exists", "delete it, or use another file name");
  const RunConfig& run = benchmark.run;
  DataConfig data = run.eval;
  data.seed = draw();
  data.sounds = draw_sounds(benchmark, draw);
  data.scenes = expand_ranges(run.eval.scenes);
  std::vector<std::vector<Episode>> episodes = draw_scenes(benchmark, draw, data);
  EpisodeSet set;
  for (std::vector<Episode>& of_scene : episodes)
    for (Episode& episode : of_scene) {
      episode.episode_id = std::to_string(set.episodes.size());
      set.episodes.push_back(std::move(episode));
    }
  set.generator = generator_keys(data, run.env);
  check_private_split(benchmark, set);

  const TemporaryFolder folder(folder_of(file), ".private_");
  const std::filesystem::path made = folder.path() / file.filename();
  save_episode_set(set, made);
  std::filesystem::permissions(made, std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
  std::string sha256 = sha256_hex(read_file(made));
  std::filesystem::rename(made, file);
  return sha256;
}

}  // namespace earshot
