// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/source_field/source_field_store.h"

#include <tbb/task_arena.h>

#include <chrono>
#include <future>
#include <map>
#include <mutex>
#include <optional>
#include <utility>

#include "sim/base/errors.h"
#include "sim/base/image_store.h"

namespace earshot {
namespace {

using Field = std::shared_ptr<const SourceField>;

/// Ending of the file names.  The content of an image has its own version, which SourceField checks.
constexpr const char* kSuffix = "field";

/// For another process that builds the same field: far longer than that takes, unless the process has been stopped.
constexpr std::chrono::minutes kPatience(10);

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

struct Entry {
  std::shared_future<Field> making;       // valid while a thread makes it
  std::weak_ptr<const SourceField> held;  // by anybody
  Field cached;                           // by the store, within its bound
  std::uint64_t last_used = 0;
};

}  // namespace

struct SourceFieldStore::Impl {
  FieldStoreConfig config;
  std::optional<ImageStore> files;

  mutable std::mutex mutex;  // guards everything below
  std::map<std::uint64_t, Entry> entries;
  std::size_t cached_bytes = 0;
  std::uint64_t clock = 0;
  FieldCounters counters;

  Field load(std::uint64_t key, const AcousticScene& scene, const EarlyCandidates& candidates) {
    if (!files) return nullptr;
    const auto image = files->load(key);
    if (!image) return nullptr;
    try {
      return std::make_shared<const SourceField>(scene, candidates, image->bytes, image->owner);
    } catch (const InputError& error) {
      files->reject(key, error.what());
      return nullptr;
    }
  }

  void count(bool built, const Field& field, double seconds) {
    const std::scoped_lock lock(mutex);
    ++(built ? counters.built : counters.loaded);
    (built ? counters.build_seconds : counters.load_seconds) += seconds;
    counters.bytes += field->image().size();
  }

  Field make(std::uint64_t key, const AcousticScene& scene, const EarlyCandidates& candidates,
             const std::function<void(double fraction)>& progress) {
    const auto start = std::chrono::steady_clock::now();
    std::error_code unknown;
    const bool was_missing = files && !std::filesystem::exists(files->path_of(key), unknown);
    if (Field loaded = load(key, scene, candidates)) {
      count(false, loaded, seconds_since(start));
      return loaded;
    }
    // Workers that begin together ask for the same fields at once: the others wait for the first, and read what it has written.
    const std::optional<FileLock> claimed = files ? files->claim(key, kPatience) : std::nullopt;
    if (files) {
      if (Field loaded = was_missing ? load(key, scene, candidates) : nullptr) {  // a damaged file is not read, and warned of, twice
        count(false, loaded, seconds_since(start));
        return loaded;
      }
    }
    // While this thread waits for parallel work, it must not pick up a task that waits for this very field.
    Field built = tbb::this_task_arena::isolate([&] { return build_source_field(scene, candidates, progress); });
    count(true, built, seconds_since(start));
    // From here on through the pages of the file, common to all processes: one copy in memory instead of one per worker.
    if (files && files->save(key, built->image()))
      if (Field mapped = load(key, scene, candidates)) return mapped;
    return built;
  }

  /// Call with the lock held.
  void keep(Entry& entry, const Field& field) {
    drop_unused_fields();
    if (field->image().size() > config.max_memory_bytes) return;
    entry.cached = field;
    cached_bytes += field->image().size();
    while (cached_bytes > config.max_memory_bytes) {
      auto oldest = entries.end();
      for (auto it = entries.begin(); it != entries.end(); ++it)
        if (it->second.cached && (oldest == entries.end() || it->second.last_used < oldest->second.last_used)) oldest = it;
      cached_bytes -= oldest->second.cached->image().size();
      oldest->second.cached.reset();
    }
  }
  void drop_unused_fields() {
    std::erase_if(entries,
                  [](const auto& item) { return !item.second.making.valid() && !item.second.cached && item.second.held.expired(); });
  }
};

SourceFieldStore::SourceFieldStore(FieldStoreConfig config) : impl_(std::make_unique<Impl>()) {
  impl_->config = std::move(config);
  if (!impl_->config.folder.empty())
    impl_->files.emplace(ImageStoreConfig{
        .folder = impl_->config.folder, .suffix = kSuffix, .max_bytes = impl_->config.max_bytes, .warn = impl_->config.warn});
}

SourceFieldStore::~SourceFieldStore() = default;

Field SourceFieldStore::get(const AcousticScene& scene, const EarlyCandidates& candidates,
                            const std::function<void(double fraction)>& progress) {
  Impl& in = *impl_;
  const std::uint64_t key = source_field_key(scene, candidates);
  std::promise<Field> promise;
  {
    std::unique_lock lock(in.mutex);
    Entry& entry = in.entries[key];
    entry.last_used = ++in.clock;
    if (Field held = entry.held.lock()) {
      ++in.counters.shared;
      return held;
    }
    if (entry.making.valid()) {
      ++in.counters.shared;
      const auto making = entry.making;
      lock.unlock();
      return making.get();
    }
    entry.making = promise.get_future().share();
  }
  Field made;
  try {
    made = in.make(key, scene, candidates, progress);
  } catch (...) {
    {
      const std::scoped_lock lock(in.mutex);
      in.entries.erase(key);  // the next request builds it again
    }
    promise.set_exception(std::current_exception());
    throw;
  }
  {
    const std::scoped_lock lock(in.mutex);
    Entry& entry = in.entries.at(key);  // not erased while it is being made
    entry.making = {};
    entry.held = made;
    in.keep(entry, made);
  }
  promise.set_value(made);
  return made;
}

FieldCounters SourceFieldStore::counters() const {
  const std::scoped_lock lock(impl_->mutex);
  return impl_->counters;
}

std::size_t SourceFieldStore::cached_bytes() const {
  const std::scoped_lock lock(impl_->mutex);
  return impl_->cached_bytes;
}

}  // namespace earshot
