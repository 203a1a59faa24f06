// SPDX-License-Identifier: Apache-2.0
#include "envs/scenes/scene_cache.h"

#include <tbb/task_arena.h>

#include <array>
#include <atomic>
#include <bit>
#include <condition_variable>
#include <deque>
#include <future>
#include <map>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "sim/base/denormals.h"
#include "sim/base/text/log.h"

namespace earshot {
namespace {

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
  /// Of one that is ready: pointers to it, that of the future included.
  [[nodiscard]] long uses() const { return future.get().use_count(); }
};

using SourceFuture = std::shared_future<std::shared_ptr<const EnvSource>>;

struct SceneEntry : Entry<EnvScene> {
  std::map<SourceKey, Entry<EnvSource>> sources;
  [[nodiscard]] std::size_t bytes_with_sources() const {
    std::size_t sum = bytes;
    for (const auto& [key, source] : sources) sum += source.bytes;
    return sum;
  }
  /// By more than this cache: by an episode, or by a source that is being built or is held itself.
  [[nodiscard]] bool is_held() const {
    long own_uses = 1;
    for (const auto& [key, source] : sources) {
      if (source.ready && source.uses() > 1) return true;
      own_uses += source.ready ? 1 : 0;
    }
    return uses() > own_uses;
  }
};

std::size_t bytes_of(const EnvSource& source) {
  return kBytesPerSource + kBytesPerImage * source.candidates.size() + kBytesPerEdgePath * source.candidates.diffraction().size() +
         (source.sound_field ? source.sound_field->image().size() : 0);
}

bool is_held(const SceneEntry& scene) { return scene.is_held(); }
bool is_held(const Entry<EnvSource>& source) { return source.uses() > 1; }

/// The least recently used ready entry, except `keep` and entries held outside; end() if there is none.
template <class Map>
typename Map::iterator least_recently_used(Map& map, const typename Map::key_type& keep) {
  auto oldest = map.end();
  for (auto it = map.begin(); it != map.end(); ++it) {
    const auto& entry = it->second;
    if (!entry.ready || it->first == keep || (oldest != map.end() && entry.last_used >= oldest->second.last_used)) continue;
    if (!is_held(entry)) oldest = it;
  }
  return oldest;
}

/// Evicted entries that another thread took hold of at that moment.
template <class T>
struct Evicted {
  std::vector<std::pair<std::weak_ptr<const T>, std::size_t>> entries;
  void add(const Entry<T>& entry) { entries.emplace_back(entry.future.get(), entry.bytes); }
  /// Of those that are still there.
  std::size_t bytes() {
    std::erase_if(entries, [](const auto& entry) { return entry.first.expired(); });
    std::size_t sum = 0;
    for (const auto& entry : entries) sum += entry.second;
    return sum;
  }
};

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
  SceneStore stored;

  Impl(FieldStoreConfig field_store, SceneStoreConfig scene_store) : fields(std::move(field_store)), stored(std::move(scene_store)) {}

  mutable std::mutex mutex;  // guards everything below
  std::map<std::string, SceneEntry> scenes;
  Evicted<EnvScene> evicted_scenes;
  Evicted<EnvSource> evicted_sources;
  std::uint64_t clock = 0, scenes_loaded = 0, sources_built = 0;
  std::deque<Wanted> wanted;
  std::atomic<std::size_t> num_ahead{0};  ///< of `wanted`, and under way; read without the mutex
  std::condition_variable_any wanted_changed;
  std::jthread prefetcher;

  /// Embree and Navmesh run parallel work: while this thread waits for it, it must not pick up another agent's reset, which could
  /// wait for the very scene that is being loaded here.
  std::shared_ptr<const EnvScene> load(const std::string& scene_id) {
    return tbb::this_task_arena::isolate([&]() -> std::shared_ptr<const EnvScene> {
      const FlushDenormals flush;
      // Fields only on request (choose_field), and what a plan would leave to them is planned without.
      AcousticConfig planned = acoustics;
      if (planned.field == Switch::automatic) planned.field = Switch::off;
      return std::make_shared<const EnvScene>(stored.load(resolve_scene(scene_id, root), planned, navmesh));
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
    evicted_scenes.add(scene->second);
    for (const auto& [key, source] : scene->second.sources)
      if (source.ready) evicted_sources.add(source);
    scenes.erase(scene);
  }
  void drop_source(SceneEntry& scene, std::map<SourceKey, Entry<EnvSource>>::iterator source) {
    evicted_sources.add(source->second);
    scene.sources.erase(source);
  }

  /// Entries of sources live in their scene's entry, which may be evicted (and loaded anew) at any time: look it up afresh each time.
  /// Under the lock.  Null: the scene is not there.
  SceneEntry* find_scene(const std::string& scene_id) {
    const auto found = scenes.find(scene_id);
    return found == scenes.end() ? nullptr : &found->second;
  }
  /// Under the lock: marks an entry that is ready or being built as used; invalid if there is neither.
  SourceFuture find_source_locked(const std::string& scene_id, const SourceKey& key) {
    SceneEntry* scene = find_scene(scene_id);
    if (!scene) return {};
    const auto found = scene->sources.find(key);
    if (found == scene->sources.end()) return {};
    scene->last_used = found->second.last_used = ++clock;  // a scene is never older than its sources
    return found->second.future;
  }
  SourceFuture find_source(const std::string& scene_id, const SourceKey& key) {
    const std::scoped_lock lock(mutex);
    return find_source_locked(scene_id, key);
  }
  /// The source if it is there or on its way.  Otherwise an invalid future, and from now on other threads wait for `promise`.
  SourceFuture find_or_announce_source(const std::string& scene_id, const SourceKey& key,
                                       std::promise<std::shared_ptr<const EnvSource>>& promise) {
    const std::scoped_lock lock(mutex);
    if (SourceFuture future = find_source_locked(scene_id, key); future.valid()) return future;
    if (SceneEntry* scene = find_scene(scene_id)) {
      Entry<EnvSource>& entry = scene->sources[key];
      entry.future = promise.get_future().share();
      scene->last_used = entry.last_used = ++clock;
    }
    return {};
  }
  /// The scene may have been evicted and reloaded meanwhile: keeps the data of another thread.
  void forget_failed_source(const std::string& scene_id, const SourceKey& key) {
    const std::scoped_lock lock(mutex);
    SceneEntry* scene = find_scene(scene_id);
    if (!scene) return;
    const auto failed = scene->sources.find(key);
    if (failed != scene->sources.end() && !failed->second.ready) scene->sources.erase(failed);
  }
  /// Counts a source that was built, and drops others for it where there are too many.
  void keep_source(const std::string& scene_id, const SourceKey& key, const EnvSource& built) {
    const std::scoped_lock lock(mutex);
    ++sources_built;
    SceneEntry* scene = find_scene(scene_id);
    if (!scene) return;
    if (const auto found = scene->sources.find(key); found != scene->sources.end() && !found->second.ready) {
      found->second.ready = true;
      found->second.bytes = bytes_of(built);
    }
    while (scene->sources.size() > kMaxSourcesPerScene) {
      const auto oldest = least_recently_used(scene->sources, key);
      if (oldest == scene->sources.end()) break;
      drop_source(*scene, oldest);
    }
    drop_over_the_bound(scene_id, key);
  }

  /// Held now.  Scenes are counted anew: they grow with what is found in them on demand.
  std::size_t count_bytes() {
    std::size_t sum = 0;
    for (auto& [id, scene] : scenes) {
      if (scene.ready) scene.bytes = scene.future.get()->bytes();
      sum += scene.bytes_with_sources();
    }
    return sum + evicted_scenes.bytes() + evicted_sources.bytes();
  }

  /// Drops the least recently used, scenes with all their sources or sources alone, except the scene and source of the arguments and what
  /// is held outside.
  void drop_over_the_bound(const std::string& keep, const SourceKey& keep_source) {
    while (count_bytes() > max_bytes) {
      const auto oldest_scene = least_recently_used(scenes, keep);
      SceneEntry* of_scene = nullptr;
      std::map<SourceKey, Entry<EnvSource>>::iterator oldest;
      for (auto& [id, scene] : scenes)
        for (auto it = scene.sources.begin(); it != scene.sources.end(); ++it)
          if (it->second.ready && !(id == keep && it->first == keep_source) &&
              (!of_scene || it->second.last_used < oldest->second.last_used) && !is_held(it->second)) {
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
      --num_ahead;
    }
  }
};

std::string resolve_scene(const std::string& scene_id, const std::filesystem::path& scene_root) {
  if (scene_root.empty() || std::filesystem::path(scene_id).is_absolute()) return scene_id;
  const std::string inside = (scene_root / scene_id).string();
  std::error_code ignored;  // "house:3" is not a file, which is not an error
  // The file is what stands before a comma: "room.glb,unit=0.01".
  for (std::size_t end = inside.size(); end != std::string::npos && end > scene_root.string().size(); end = inside.rfind(',', end - 1))
    if (std::filesystem::exists(inside.substr(0, end), ignored)) return inside;
  return scene_id;
}

SceneCache::SceneCache(const AcousticConfig& acoustics, const NavmeshConfig& navmesh, std::filesystem::path scene_root,
                       std::size_t max_bytes, FieldStoreConfig fields, SceneStoreConfig scenes) {
  fields.max_memory_bytes = 0;  // the sources here hold what is used
  fields.warn = log_warning;
  scenes.warn = fields.warn;
  impl_ = std::make_unique<Impl>(std::move(fields), std::move(scenes));
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
  std::optional<std::promise<std::shared_ptr<const EnvScene>>> promise;  // of this thread, if it is the one that loads
  {
    std::unique_lock lock(in.mutex);
    if (const auto found = in.scenes.find(scene_id); found != in.scenes.end()) {
      found->second.last_used = ++in.clock;
      const auto future = found->second.future;
      lock.unlock();
      return future.get();
    }
    SceneEntry& entry = in.scenes[scene_id];
    entry.future = promise.emplace().get_future().share();
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
    promise->set_exception(std::current_exception());
    throw;
  }
  {
    const std::scoped_lock lock(in.mutex);
    SceneEntry& entry = in.scenes.at(scene_id);
    promise->set_value(loaded);
    entry.ready = true;
    ++in.scenes_loaded;
    in.drop_over_the_bound(scene_id, {});
  }
  return loaded;
}

std::shared_ptr<const EnvSource> SceneCache::source(const std::string& scene_id, glm::dvec3 goal, float source_height_m) {
  Impl& in = *impl_;
  const SourceKey key = key_of(goal, source_height_m);
  if (const SourceFuture future = in.find_source(scene_id, key); future.valid()) return future.get();
  const std::shared_ptr<const EnvScene> loaded_scene = scene(scene_id);
  std::promise<std::shared_ptr<const EnvSource>> promise;
  if (const SourceFuture future = in.find_or_announce_source(scene_id, key, promise); future.valid()) return future.get();
  std::shared_ptr<const EnvSource> built;
  try {
    built = in.build(loaded_scene, loaded_scene->scene->to_local(goal), source_height_m);
  } catch (...) {
    in.forget_failed_source(scene_id, key);
    promise.set_exception(std::current_exception());
    throw;
  }
  promise.set_value(built);
  in.keep_source(scene_id, key, *built);
  return built;
}

void SceneCache::prefetch(const std::string& scene_id, glm::dvec3 goal, float source_height_m) {
  Impl& in = *impl_;
  const std::scoped_lock lock(in.mutex);
  if (const auto loaded = in.scenes.find(scene_id); loaded != in.scenes.end())
    if (const auto known = loaded->second.sources.find(key_of(goal, source_height_m)); known != loaded->second.sources.end()) {
      loaded->second.last_used = known->second.last_used = ++in.clock;  // it stays for the episode that is to come
      return;
    }
  if (!in.prefetcher.joinable()) in.prefetcher = std::jthread([this](const std::stop_token& stop) { impl_->prefetch_until(stop, *this); });
  if (in.wanted.size() >= kMaxPrefetches) {
    in.wanted.pop_front();
    --in.num_ahead;
  }
  in.wanted.push_back({scene_id, goal, source_height_m});
  ++in.num_ahead;
  in.wanted_changed.notify_one();
}

bool SceneCache::loads_ahead() const { return impl_->num_ahead > 0; }

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
  return impl_->count_bytes();
}

std::size_t SceneCache::held_bytes() const {
  const std::scoped_lock lock(impl_->mutex);
  std::size_t sum = impl_->evicted_scenes.bytes() + impl_->evicted_sources.bytes();
  for (const auto& [id, scene] : impl_->scenes) {
    if (scene.ready && scene.is_held()) sum += scene.future.get()->bytes();
    for (const auto& [key, source] : scene.sources) sum += source.ready && is_held(source) ? source.bytes : 0;
  }
  return sum;
}

FieldCounters SceneCache::field_counters() const { return impl_->fields.counters(); }

SceneStoreCounters SceneCache::scene_store_counters() const { return impl_->stored.counters(); }

}  // namespace earshot
