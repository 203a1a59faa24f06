// SPDX-License-Identifier: Apache-2.0
#include "envs/scenes/scene_store.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <chrono>
#include <filesystem>
#include <mutex>
#include <optional>
#include <set>
#include <string_view>
#include <system_error>
#include <utility>

#include "sim/acoustics/model/acoustic_image.h"
#include "sim/base/engine_commit.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/image_store.h"
#include "sim/base/stopwatch.h"
#include "sim/base/text/config_reader.h"
#include "sim/nav/navmesh_image.h"
#include "sim/scene/checks/scene_check.h"
#include "sim/scene/scene_image.h"
#include "sim/scene/scene_inputs.h"

namespace earshot {
namespace {

/// Version of the layout of the images.  Their content has the commit of the engine.
constexpr std::string_view kVersion = "scene store 4";

/// For another process that makes the same: far longer than that takes, unless the process has been stopped.
constexpr std::chrono::minutes kPatience(10);

/// The commit; where that does not tell what was built, the program file too.
std::string engine_identity() {
  std::string identity = fmt::format("{}|{}|{}", kVersion, engine_commit(), build_type());
  if (engine_commit().ends_with("-dirty") || engine_commit() == "unknown") {
    struct stat program {};
    if (::stat("/proc/self/exe", &program) == 0)
      identity += fmt::format("|{}|{}|{}|{}", program.st_ino, program.st_size, program.st_mtim.tv_sec, program.st_mtim.tv_nsec);
  }
  return identity;
}

/// Every key of the config but those that change no scene.
std::string text_of(AcousticConfig config) {
  config.seed = 0;
  config.threads = 1;
  ConfigReader recorder = ConfigReader::recorder();
  read(recorder, config);
  return recorder.effective();
}

std::string text_of(const NavmeshConfig& c) {
  std::string text;
  for (const float value :
       {c.agent_radius_m, c.agent_height_m, c.max_climb_m, c.max_slope_deg, c.cell_size_m, c.cell_height_m, c.min_region_area_m2})
    text += fmt::format("{} ", value);
  return text;
}

}  // namespace

struct SceneStore::Impl {
  explicit Impl(SceneStoreConfig c)
      : config(std::move(c)), scenes(part("scene")), acoustics(part("acoustics")), navmeshes(part("navmesh")) {}

  ImageStore part(const char* suffix) const {
    return ImageStore({.folder = config.folder, .suffix = suffix, .max_bytes = config.max_bytes, .warn = config.warn});
  }

  /// The content of the file, or nullopt.  decode(bytes, where) throws InputError for an invalid content.
  template <class Decode>
  auto read(ImageStore& store, std::uint64_t key, const Decode& decode) -> std::optional<decltype(decode(std::string_view(), ""))> {
    const auto image = store.load(key);
    if (!image) return std::nullopt;
    try {
      auto value =
          decode(std::string_view(reinterpret_cast<const char*>(image->bytes.data()), image->bytes.size()), store.path_of(key).string());
      const std::scoped_lock lock(mutex);
      counters.bytes_read += image->bytes.size();
      return value;
    } catch (const InputError& error) {
      store.reject(key, error.what());
      return std::nullopt;
    }
  }

  /// The content of the file, else the result of make(), which is written there.
  template <class Decode, class Make, class Encode>
  auto read_or_make(ImageStore& store, std::uint64_t key, bool& made, const Decode& decode, const Make& make, const Encode& encode) {
    std::error_code unknown;
    const bool was_missing = !std::filesystem::exists(store.path_of(key), unknown);
    if (auto known = read(store, key, decode)) return std::move(*known);
    // Workers that begin together ask for the same scenes at once: the others wait for the first, and read what it has written.
    const std::optional<FileLock> claimed = store.claim(key, kPatience);
    if (was_missing)  // a damaged file is not read, and warned of, twice
      if (auto known = read(store, key, decode)) return std::move(*known);
    made = true;
    auto value = make();
    store.save(key, std::as_bytes(std::span<const char>(encode(value))));
    return value;
  }

  /// Says what is odd about a scene when it is first loaded.
  [[nodiscard]] Scene load_and_warn(const std::string& spec) {
    Scene scene = load_scene(spec);
    if (config.warn && is_new(spec))
      for (const std::string& warning : scene_warnings(scene)) config.warn(spec + ": " + warning);
    return scene;
  }

  [[nodiscard]] bool is_new(const std::string& spec) {
    const std::lock_guard lock(mutex);
    return loaded.insert(spec).second;
  }

  EnvScene load(const std::string& spec, std::uint64_t inputs, const AcousticConfig& acoustic_config, const NavmeshConfig& navmesh_config,
                bool& made) {
    const std::uint64_t scene_key = hash64(identity, inputs);
    const auto scene = std::make_shared<const Scene>(read_or_make(
        scenes, scene_key, made, decode_scene, [&] { return load_and_warn(spec); }, encode_scene));
    const std::uint64_t content = hash64(identity, scene->hash());
    return {scene,
            read_or_make(
                acoustics, hash64(text_of(acoustic_config), content), made,
                [&](std::string_view bytes, const std::string& where) { return decode_acoustics(bytes, scene, acoustic_config, where); },
                [&] { return AcousticScene(scene, acoustic_config); }, encode_acoustics),
            read_or_make(
                navmeshes, hash64(text_of(navmesh_config), content), made,
                [&](std::string_view bytes, const std::string& where) { return decode_navmesh(bytes, navmesh_config, where); },
                [&] { return Navmesh(scene->mesh(), navmesh_config); }, encode_navmesh)};
  }

  SceneStoreConfig config;
  std::string identity = engine_identity();
  ImageStore scenes, acoustics, navmeshes;
  mutable std::mutex mutex;  // guards what is below
  SceneStoreCounters counters;
  std::set<std::string> loaded;  ///< specs
};

SceneStore::SceneStore(SceneStoreConfig config) : impl_(std::make_unique<Impl>(std::move(config))) {}
SceneStore::~SceneStore() = default;

EnvScene SceneStore::load(const std::string& spec, const AcousticConfig& acoustics, const NavmeshConfig& navmesh) {
  Impl& in = *impl_;
  validate(acoustics);
  validate(navmesh);
  const Stopwatch watch;
  bool made = false;
  const std::optional<std::uint64_t> inputs = in.config.folder.empty() ? std::nullopt : hash_of_scene_inputs(spec);
  EnvScene loaded = [&]() -> EnvScene {
    if (inputs) return in.load(spec, *inputs, acoustics, navmesh, made);
    made = true;
    const auto scene = std::make_shared<const Scene>(in.load_and_warn(spec));
    return {scene, AcousticScene(scene, acoustics), Navmesh(scene->mesh(), navmesh)};
  }();
  const std::scoped_lock lock(in.mutex);
  ++(made ? in.counters.built : in.counters.read);
  (made ? in.counters.build_seconds : in.counters.read_seconds) += watch.wall_s();
  return loaded;
}

SceneStoreCounters SceneStore::counters() const {
  const std::scoped_lock lock(impl_->mutex);
  return impl_->counters;
}

}  // namespace earshot
