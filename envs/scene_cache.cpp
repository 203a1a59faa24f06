#include "envs/scene_cache.h"

#include <spdlog/spdlog.h>
#include <tbb/task_arena.h>

#include <array>
#include <bit>
#include <condition_variable>
#include <deque>
#include <future>
#include <map>
#include <mutex>
#include <thread>
#include <utility>

#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/base/denormals.h"

namespace earshot {
namespace {

/// An estimate: 28 bytes of mesh, 36 of vertices and indices in Embree, about 100 of BVH, 64 for the data of hits, 4 of the plane table,
/// and slack.
constexpr std::size_t kBytesPerTriangle = 256;
constexpr std::size_t kBytesPerScene = std::size_t{1} << 20;
constexpr std::size_t kMaxSourcesPerScene = 256;
/// Of a source without its sound field: 156 bytes per image and 64 per diffraction path, and what belongs to no path (distances of the
/// corners, blocks of the allocator).  50 to 200 KiB in a house: 256 sources take ten times what their scene does.
constexpr std::size_t kBytesPerImage = 160, kBytesPerEdgePath = 64, kBytesPerSource = 16384;
constexpr std::size_t kMaxPrefetches = 256;

using SourceKey = std::array<std::uint64_t, 4>;

SourceKey key_of(glm::dvec3 goal, float source_height_m) {
  return {std::bit_cast<std::uint64_t>(goal.x), std::bit_cast<std::uint64_t>(goal.y), std::bit_cast<std::uint64_t>(goal.z),
          std::bit_cast<std::uint32_t>(source_height_m)};
}

/// Something that is loaded once: the first request makes it, the others wait for the future.
template <class T>
struct Entry {
  std::shared_future<std::shared_ptr<const T>> future;
  std::uint64_t last_used = 0;
  std::size_t bytes = 0;
  bool ready = false;
};

struct SceneEntry : Entry<EnvScene> {
  std::map<SourceKey, Entry<EnvSource>> sources;
  [[nodiscard]] std::size_t bytes_with_sources() const {
    std::size_t sum = bytes;
    for (const auto& [key, source] : sources) sum += source.bytes;
    return sum;
  }
};

std::size_t bytes_of(const EnvSource& source) {
  return kBytesPerSource + kBytesPerImage * source.candidates.size() + kBytesPerEdgePath * source.candidates.diffraction().size() +
         (source.sound_field ? source.sound_field->image().size() : 0);
}

/// The ready entry that was used longest ago, `keep` excepted; end() if there is none.
template <class Map>
typename Map::iterator least_recently_used(Map& map, const typename Map::key_type& keep) {
  auto oldest = map.end();
  for (auto it = map.begin(); it != map.end(); ++it)
    if (it->second.ready && it->first != keep && (oldest == map.end() || it->second.last_used < oldest->second.last_used)) oldest = it;
  return oldest;
}

struct Wanted {
  std::string scene_id;
  glm::dvec3 goal;
  float source_height_m;
};

}  // namespace

struct SceneCache::Impl {
  AcousticConfig acoustics;
  NavmeshConfig navmesh;
  std::filesystem::path root;
  std::size_t max_bytes;
  SourceFieldStore fields;

  explicit Impl(FieldStoreConfig field_store) : fields(std::move(field_store)) {}

  mutable std::mutex mutex;  // guards everything below
  std::map<std::string, SceneEntry> scenes;
  std::size_t bytes = 0;
  std::uint64_t clock = 0, scenes_loaded = 0, sources_built = 0;
  std::deque<Wanted> wanted;
  std::condition_variable_any wanted_changed;
  std::jthread prefetcher;

  std::string resolve(const std::string& scene_id) const {
    if (root.empty() || std::filesystem::path(scene_id).is_absolute()) return scene_id;
    const std::filesystem::path inside = root / scene_id;
    std::error_code ignored;  // "house:3" is no file, and that is fine
    return std::filesystem::exists(inside, ignored) ? inside.string() : scene_id;
  }

  /// Embree and Navmesh run parallel work: while this thread waits for it, it must not pick up another agent's reset, which could
  /// wait for the very scene that is being loaded here.
  std::shared_ptr<const EnvScene> load(const std::string& scene_id) const {
    return tbb::this_task_arena::isolate([&]() -> std::shared_ptr<const EnvScene> {
      const FlushDenormals flush;
      auto scene = std::make_shared<const Scene>(load_scene(resolve(scene_id)));
      // Episodes are short: fields only on request, and what a plan would leave to them is planned without.
      AcousticConfig planned = acoustics;
      if (planned.field == Switch::automatic) planned.field = Switch::off;
      return std::make_shared<const EnvScene>(EnvScene{scene, AcousticScene(scene, planned), Navmesh(scene->mesh(), navmesh)});
    });
  }
  std::shared_ptr<const EnvSource> build(std::shared_ptr<const EnvScene> scene, glm::vec3 goal, float source_height_m) {
    return tbb::this_task_arena::isolate([&]() -> std::shared_ptr<const EnvSource> {
      const FlushDenormals flush;
      const EnvScene& in = *scene;
      GeodesicField field(in.navmesh, goal);  // first: it refuses a goal far from the scene before rays are traced from there
      EarlyCandidates candidates(in.acoustics, goal + glm::vec3(0, source_height_m, 0));
      auto sound_field = uses_source_field(in.acoustics) ? fields.get(in.acoustics, candidates) : nullptr;
      return std::make_shared<const EnvSource>(EnvSource{scene, std::move(field), std::move(candidates), std::move(sound_field)});
    });
  }

  void drop_scene(std::map<std::string, SceneEntry>::iterator scene) {
    bytes -= scene->second.bytes_with_sources();
    scenes.erase(scene);
  }
  void drop_source(SceneEntry& scene, std::map<SourceKey, Entry<EnvSource>>::iterator source) {
    bytes -= source->second.bytes;
    scene.sources.erase(source);
  }

  /// Drops the least recently used, scenes with all their sources or sources alone, except the scene and source of the arguments.
  void drop_over_the_bound(const std::string& keep, const SourceKey& keep_source) {
    while (bytes > max_bytes) {
      const auto oldest_scene = least_recently_used(scenes, keep);
      SceneEntry* of_scene = nullptr;
      std::map<SourceKey, Entry<EnvSource>>::iterator oldest;
      for (auto& [id, scene] : scenes)
        for (auto it = scene.sources.begin(); it != scene.sources.end(); ++it)
          if (it->second.ready && !(id == keep && it->first == keep_source) &&
              (!of_scene || it->second.last_used < oldest->second.last_used)) {
            of_scene = &scene;
            oldest = it;
          }
      if (of_scene && (oldest_scene == scenes.end() || oldest->second.last_used <= oldest_scene->second.last_used))
        drop_source(*of_scene, oldest);
      else if (oldest_scene != scenes.end())
        drop_scene(oldest_scene);
      else
        return;
    }
  }

  void prefetch_until(const std::stop_token& stop, SceneCache& cache) {
    flush_denormals_on_this_thread();
    while (true) {
      Wanted next;
      {
        std::unique_lock lock(mutex);
        if (!wanted_changed.wait(lock, stop, [&] { return !wanted.empty(); }) || stop.stop_requested()) return;
        next = std::move(wanted.front());
        wanted.pop_front();
      }
      try {
        cache.source(next.scene_id, next.goal, next.source_height_m);
      } catch (const std::exception&) {
        // The next call of source() loads again and throws the error.
      }
    }
  }
};

SceneCache::SceneCache(const AcousticConfig& acoustics, const NavmeshConfig& navmesh, std::filesystem::path scene_root,
                       std::size_t max_bytes, FieldStoreConfig fields) {
  fields.max_memory_bytes = 0;  // the sources here hold what is used
  fields.warn = [](const std::string& message) { spdlog::warn("{}", message); };
  impl_ = std::make_unique<Impl>(std::move(fields));
  validate(acoustics);
  validate(navmesh);
  impl_->acoustics = acoustics;
  impl_->navmesh = navmesh;
  impl_->root = std::move(scene_root);
  impl_->max_bytes = max_bytes;
}

SceneCache::~SceneCache() { impl_->prefetcher = {}; }

std::shared_ptr<const EnvScene> SceneCache::scene(const std::string& scene_id) {
  Impl& in = *impl_;
  std::promise<std::shared_ptr<const EnvScene>> promise;
  {
    std::unique_lock lock(in.mutex);
    if (const auto found = in.scenes.find(scene_id); found != in.scenes.end()) {
      found->second.last_used = ++in.clock;
      const auto future = found->second.future;
      lock.unlock();
      return future.get();
    }
    SceneEntry& entry = in.scenes[scene_id];
    entry.future = promise.get_future().share();
    entry.last_used = ++in.clock;
  }
  std::shared_ptr<const EnvScene> loaded;
  try {
    loaded = in.load(scene_id);
  } catch (...) {
    {
      const std::scoped_lock lock(in.mutex);
      in.scenes.erase(scene_id);  // not ready, so no other thread erased it; the next request tries again
    }
    promise.set_exception(std::current_exception());
    throw;
  }
  {
    const std::scoped_lock lock(in.mutex);
    SceneEntry& entry = in.scenes.at(scene_id);
    entry.ready = true;
    entry.bytes = kBytesPerScene + kBytesPerTriangle * loaded->scene->mesh().triangles.size();
    in.bytes += entry.bytes;
    ++in.scenes_loaded;
    in.drop_over_the_bound(scene_id, {});
  }
  promise.set_value(loaded);
  return loaded;
}

std::shared_ptr<const EnvSource> SceneCache::source(const std::string& scene_id, glm::dvec3 goal, float source_height_m) {
  Impl& in = *impl_;
  const SourceKey key = key_of(goal, source_height_m);
  const std::shared_ptr<const EnvScene> loaded_scene = scene(scene_id);
  std::promise<std::shared_ptr<const EnvSource>> promise;
  // Entries live in their scene's entry, which may be evicted (and loaded anew) at any time: look it up afresh each time.
  const auto entry_of_scene = [&]() -> SceneEntry* {
    const auto found = in.scenes.find(scene_id);
    return found == in.scenes.end() ? nullptr : &found->second;
  };
  {
    std::unique_lock lock(in.mutex);
    if (SceneEntry* entry_of = entry_of_scene()) {
      entry_of->last_used = ++in.clock;  // a scene is never older than its sources
      if (const auto found = entry_of->sources.find(key); found != entry_of->sources.end()) {
        found->second.last_used = in.clock;
        const auto future = found->second.future;
        lock.unlock();
        return future.get();
      }
      Entry<EnvSource>& entry = entry_of->sources[key];
      entry.future = promise.get_future().share();
      entry.last_used = in.clock;
    }
  }
  std::shared_ptr<const EnvSource> built;
  try {
    built = in.build(loaded_scene, loaded_scene->scene->to_local(goal), source_height_m);
  } catch (...) {
    {
      const std::scoped_lock lock(in.mutex);
      // The scene may have been dropped and loaded anew meanwhile: what another thread has made there stays.
      if (SceneEntry* entry_of = entry_of_scene()) {
        const auto failed = entry_of->sources.find(key);
        if (failed != entry_of->sources.end() && !failed->second.ready) entry_of->sources.erase(failed);
      }
    }
    promise.set_exception(std::current_exception());
    throw;
  }
  {
    const std::scoped_lock lock(in.mutex);
    ++in.sources_built;
    if (SceneEntry* entry_of = entry_of_scene()) {
      if (const auto found = entry_of->sources.find(key); found != entry_of->sources.end() && !found->second.ready) {
        found->second.ready = true;
        found->second.bytes = bytes_of(*built);
        in.bytes += found->second.bytes;
      }
      while (entry_of->sources.size() > kMaxSourcesPerScene) {
        const auto oldest = least_recently_used(entry_of->sources, key);
        if (oldest == entry_of->sources.end()) break;
        in.drop_source(*entry_of, oldest);
      }
      in.drop_over_the_bound(scene_id, key);
    }
  }
  promise.set_value(built);
  return built;
}

void SceneCache::prefetch(const std::string& scene_id, glm::dvec3 goal, float source_height_m) {
  Impl& in = *impl_;
  const std::scoped_lock lock(in.mutex);
  if (!in.prefetcher.joinable()) in.prefetcher = std::jthread([this](const std::stop_token& stop) { impl_->prefetch_until(stop, *this); });
  if (in.wanted.size() >= kMaxPrefetches) in.wanted.pop_front();
  in.wanted.push_back({scene_id, goal, source_height_m});
  in.wanted_changed.notify_one();
}

const AcousticConfig& SceneCache::acoustics() const { return impl_->acoustics; }

std::size_t SceneCache::num_scenes() const {
  const std::scoped_lock lock(impl_->mutex);
  return impl_->scenes.size();
}

std::uint64_t SceneCache::scenes_loaded() const {
  const std::scoped_lock lock(impl_->mutex);
  return impl_->scenes_loaded;
}

std::uint64_t SceneCache::sources_built() const {
  const std::scoped_lock lock(impl_->mutex);
  return impl_->sources_built;
}

std::size_t SceneCache::bytes() const {
  const std::scoped_lock lock(impl_->mutex);
  return impl_->bytes;
}

FieldCounters SceneCache::field_counters() const { return impl_->fields.counters(); }

}  // namespace earshot
