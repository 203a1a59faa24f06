// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/source_field/refining_field.h"

#include <algorithm>
#include <condition_variable>
#include <exception>
#include <limits>
#include <map>
#include <mutex>
#include <thread>
#include <utility>

#include "sim/base/denormals.h"
#include "sim/base/errors.h"

namespace earshot {

struct RefiningField::Impl {
  mutable std::mutex mutex;  // guards everything below
  std::condition_variable changed;
  std::map<int, std::shared_ptr<const SourceField>> snapshots;  // by number, those that may still be needed
  int made = 0, wanted_from = 0;
  bool finished = false;
  std::exception_ptr failure;
  std::jthread thread;  // last, so that it ends before what it uses goes

  void refine(const std::stop_token& stop, const AcousticScene& scene, const EarlyCandidates& candidates) {
    flush_denormals_on_this_thread();
    try {
      SourceFieldBuilder builder(scene, candidates);
      while (!stop.stop_requested() && builder.refine()) publish(builder.snapshot());
    } catch (...) {
      const std::scoped_lock lock(mutex);
      failure = std::current_exception();
    }
    const std::scoped_lock lock(mutex);
    finished = true;
    changed.notify_all();
  }

  void publish(std::shared_ptr<const SourceField> snapshot) {
    const std::scoped_lock lock(mutex);
    snapshots[made] = std::move(snapshot);
    ++made;
    give_up_before_wanted();
    changed.notify_all();
  }

  /// The newest one always remains: it stands for all later ones.
  void give_up_before_wanted() {
    std::erase_if(snapshots, [&](const auto& item) { return item.first < wanted_from && item.first + 1 < made; });
  }
};

RefiningField::RefiningField(const AcousticScene& scene, const EarlyCandidates& candidates) : impl_(std::make_unique<Impl>()) {
  impl_->thread =
      std::jthread([in = impl_.get(), &scene, &candidates](const std::stop_token& stop) { in->refine(stop, scene, candidates); });
}

RefiningField::~RefiningField() = default;

std::shared_ptr<const SourceField> RefiningField::wait_for(int n) {
  EARSHOT_EXPECT(n >= 0);
  Impl& in = *impl_;
  std::unique_lock lock(in.mutex);
  in.wanted_from = std::max(in.wanted_from, n);
  in.give_up_before_wanted();
  in.changed.wait(lock, [&] { return in.finished || in.made > n; });
  if (in.failure) std::rethrow_exception(in.failure);
  const auto found = in.snapshots.find(n);
  return found != in.snapshots.end() ? found->second : in.snapshots.rbegin()->second;
}

std::shared_ptr<const SourceField> RefiningField::wait_for_target() { return wait_for(std::numeric_limits<int>::max()); }

std::shared_ptr<const SourceField> RefiningField::latest() const {
  const std::scoped_lock lock(impl_->mutex);
  return impl_->snapshots.empty() ? nullptr : impl_->snapshots.rbegin()->second;
}

int RefiningField::num_snapshots() const {
  const std::scoped_lock lock(impl_->mutex);
  return impl_->made;
}

bool RefiningField::finished() const {
  const std::scoped_lock lock(impl_->mutex);
  return impl_->finished;
}

}  // namespace earshot
