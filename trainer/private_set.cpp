#include "trainer/private_set.h"

#include <fmt/format.h>
#include <sys/random.h>

#include <algorithm>
#include <set>
#include <vector>

#include "envs/name_ranges.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/sha256.h"
#include "trainer/episode_data.h"
#include "trainer/split_overlap.h"

namespace earshot {
namespace {

/// Beyond what configs are written with, and far more of them than could be tried.
constexpr std::uint64_t kLeastSeed = 1'000'000'000, kSeedCount = std::uint64_t{1} << 48;

std::uint64_t secret_seed() {
  std::uint64_t bits = 0;
  if (::getrandom(&bits, sizeof(bits), 0) != sizeof(bits)) throw RunError("getrandom", "gives no bytes");
  return kLeastSeed + bits % kSeedCount;
}

/// "house:3,rooms=2" with another seed.
std::string other_scene(const std::string& scene) {
  const bool generated = scene.starts_with("house:") || scene.starts_with("floor:");
  if (!generated)
    throw InputError(scene, "is a scene that no seed generates: another one cannot be drawn",
                     "write the private set yourself (earshot dataset episodes), and publish its SHA-256");
  const std::size_t begin = scene.find(':') + 1, end = std::min(scene.find(',', begin), scene.size());
  return scene.substr(0, begin) + std::to_string(secret_seed()) + scene.substr(end);
}

/// "synth:bird:3" with another seed.
std::string other_sound(const std::string& sound) {
  if (!sound.starts_with("synth:"))
    throw InputError(sound, "is a sound that no seed generates: another one cannot be drawn",
                     "write the private set yourself (earshot dataset episodes), and publish its SHA-256");
  return sound.substr(0, sound.find(':', std::string_view("synth:").size())) + ":" + std::to_string(secret_seed());
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
std::vector<std::string> joined(std::vector<std::string> list, const Add& more) {
  list.insert(list.end(), more.begin(), more.end());
  return list;
}

}  // namespace

Benchmark with_private_set(const Benchmark& benchmark, const std::filesystem::path& file) {
  if (benchmark.private_sha256.empty())
    throw InputError(benchmark.name, "names no private set: it has no benchmark.private.sha256",
                     "make one with 'earshot benchmark FILE --make-private SET', and put its SHA-256 into the file");
  const std::string sha256 = sha256_hex(read_file(file));
  if (sha256 != benchmark.private_sha256)
    throw InputError(file.string(),
                     fmt::format("has the SHA-256 {}, the private set of {} {} has {}", sha256, benchmark.name, benchmark.version,
                                 benchmark.private_sha256),
                     "take the file whose SHA-256 was published");
  Benchmark with = benchmark;
  with.run.eval.file = file.string();
  with.set_hash = hex64(load_episode_set(file).hash);
  return with;
}

void check_private_split(const Benchmark& benchmark, const EpisodeSet& private_set) {
  const RunConfig& run = benchmark.run;
  const auto refuse = [&](const SplitOverlap& found, const char* whose) {
    throw InputError("the private set of " + benchmark.name,
                     fmt::format("has '{}', {} '{}' of {}", found.tested, found.why, found.trained, whose), "make another one");
  };
  constexpr const char* kOthers = "the training or the public test set";
  const auto trained = expand_sounds(run.train.sounds), tested = expand_sounds(run.eval.sounds), own = sounds_of(private_set);
  check_held_out_kinds(benchmark, trained, joined(tested, own));
  const auto heard = expand_sounds(benchmark.heard_sounds);
  std::vector<std::string> fresh;
  std::ranges::copy_if(own, std::back_inserter(fresh), [&](const auto& sound) { return std::ranges::count(heard, sound) == 0; });
  if (const auto found = find_sound_overlap(joined(trained, tested), fresh, run.env.sound_root)) refuse(*found, kOthers);
  const auto scenes = joined(expand_ranges(run.train.scenes), expand_ranges(run.eval.scenes));
  if (const auto found = find_scene_overlap(scenes, scenes_of(private_set), run.env.scene_root)) refuse(*found, kOthers);
}

std::string make_private_set(const Benchmark& benchmark, const std::filesystem::path& file) {
  if (std::filesystem::exists(file)) throw InputError(file.string(), "is there already", "remove it, or name another file");
  const auto heard = expand_sounds(benchmark.heard_sounds);
  DataConfig data = benchmark.run.eval;
  data.file = file.string();
  data.seed = secret_seed();
  data.scenes = expand_ranges(data.scenes);
  for (std::string& scene : data.scenes) scene = other_scene(scene);
  data.sounds = expand_sounds(data.sounds);
  for (std::string& sound : data.sounds)
    if (std::ranges::count(heard, sound) == 0) sound = other_sound(sound);
  const EpisodeSet set = generate_data(data, benchmark.run.env);
  std::filesystem::permissions(file, std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
  try {
    check_private_split(benchmark, set);
  } catch (const InputError&) {
    std::filesystem::remove(file);
    throw;
  }
  return sha256_hex(read_file(file));
}

}  // namespace earshot
