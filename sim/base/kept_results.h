// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <map>
#include <memory>
#include <mutex>
#include <stop_token>

#include "sim/base/errors.h"

namespace earshot {

/// Results by key, each made once and kept.  Safe from any thread: no lock is held while a result is made, so that callers find the
/// results that are there meanwhile, and make those of other keys.
///
/// \code
/// KeptResults<int, AcousticScene> scenes;
/// std::shared_ptr<const AcousticScene> scene = scenes.get(order, [&] { return std::make_shared<const AcousticScene>(geometry, config); });
/// \endcode
template <class Key, class Value>
class KeptResults {
 public:
  /// The result of this key.  The first caller makes it; others with the same key wait for that one.  If make() throws, its caller gets
  /// the exception, and the next one makes the result.  make() must not ask for the same key.
  /// @throws RunError if `stop` is requested during a wait.
  template <class Make>
  std::shared_ptr<const Value> get(const Key& key, const Make& make, const std::stop_token& stop = {}) {
    std::unique_lock lock(mutex_);
    Entry& entry = entries_[key];  // stays where it is
    if (!changed_.wait(lock, stop, [&] { return !entry.is_being_made; })) throw RunError("call", "was stopped by its caller");
    if (entry.value) return entry.value;
    entry.is_being_made = true;
    std::shared_ptr<const Value> made;
    lock.unlock();
    try {
      made = make();
    } catch (...) {
      lock.lock();
      entry.is_being_made = false;
      changed_.notify_all();
      throw;
    }
    lock.lock();
    entry.value = made;
    entry.is_being_made = false;
    changed_.notify_all();
    return made;
  }

  /// Drops the result of this key if it is `value`.  Those who hold it keep it.
  void drop(const Key& key, const std::shared_ptr<const Value>& value) {
    const std::lock_guard lock(mutex_);
    if (const auto found = entries_.find(key); found != entries_.end() && found->second.value == value) found->second.value = nullptr;
  }

 private:
  struct Entry {
    std::shared_ptr<const Value> value;
    bool is_being_made = false;
  };

  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::map<Key, Entry> entries_;
};

}  // namespace earshot
