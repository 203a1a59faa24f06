// SPDX-License-Identifier: Apache-2.0
#include "envs/batch/env_workers.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/processor.h"

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;

/// Tasks that a thread takes at once, at most.
constexpr std::size_t kMaxAtOnce = 8;
/// Largest number of threads that replace those of abandoned tasks that still run; then the batch ends.
constexpr std::size_t kMaxReplacements = 64;
/// A batch without sound and picture takes some ten microseconds, and so does waking a thread: this long a thread looks for work before
/// it sleeps.
constexpr int kWorkerSpins = 2000;
constexpr std::uint32_t kNothing = 0, kGivenUp = ~std::uint32_t{0};

/// State of a worker in one word, so that a task is either abandoned or continues: the environment + 1 below, stages begun above.
constexpr std::uint64_t at_work(std::uint32_t env, std::uint64_t stages) { return stages << 32 | env; }
constexpr std::uint32_t env_of(std::uint64_t state) { return static_cast<std::uint32_t>(state); }

struct alignas(64) Worker {
  std::atomic<std::uint64_t> state{0};
};

}  // namespace

struct EnvWorkers::Shared {
  Shared(int thread_count, std::size_t envs, double limit_s, Task stage_task)
      : task(std::move(stage_task)),
        stage_limit_s(limit_s),
        mask(std::bit_ceil(envs) - 1),
        queue(mask + 1),
        done(mask + 1),
        returned(envs),
        workers(static_cast<std::size_t>(thread_count) + 1 + kMaxReplacements),
        threads_wanted(static_cast<std::size_t>(thread_count)) {}

  Task task;
  double stage_limit_s;
  std::size_t mask;
  // Rings: at most one entry per environment, so neither overflows.  done: environment * 2 + stalled + 1, 0: none.
  std::vector<std::atomic<std::uint32_t>> queue;
  std::vector<std::atomic<std::uint64_t>> done;
  std::atomic<std::uint64_t> pushed{0}, claimed{0}, done_slots{0};
  std::atomic<std::uint32_t> wake{0}, completed{0};  // both count; waited on
  std::uint64_t received = 0;                        // of `done`, by the thread that waits
  std::uint64_t submitted = 0;
  std::vector<std::atomic<bool>> returned;
  std::atomic<std::size_t> given_up{0};
  std::atomic<bool> stop{false}, hopeless{false};

  std::vector<Worker> workers;
  std::size_t threads_wanted;
  std::atomic<std::size_t> workers_used{1};  // number 0 is the thread that waits
  bool caller_works = true;

  std::mutex mutex;                                          // guards the threads, and what the watch sleeps on
  std::vector<std::pair<std::size_t, std::thread>> threads;  // by worker number
  std::vector<std::size_t> free_numbers;                     // of threads that were given up and have ended
  std::condition_variable watch_wakes;
  std::thread watch;

  void complete(std::uint32_t env, bool stalled) {
    const std::uint64_t slot = done_slots.fetch_add(1, std::memory_order_acq_rel);
    done[slot & mask].store(std::uint64_t{env} * 2 + (stalled ? 1 : 0) + 1, std::memory_order_release);
    completed.fetch_add(1, std::memory_order_release);
    completed.notify_one();
  }

  /// Tasks that a thread takes at once, of so many that wait: fewer and fewer, so that threads end together.  With a limit one, as
  /// tasks behind one that stalls would wait with it.
  [[nodiscard]] std::uint64_t tasks_at_once(std::uint64_t waiting) const {
    return stage_limit_s > 0 ? 1 : std::clamp<std::uint64_t>(waiting / (2 * threads_wanted), 1, kMaxAtOnce);
  }

  /// Runs some tasks, if any wait.  False: none did.  gone: set if this worker was given up meanwhile.
  bool work(std::size_t number, bool& gone) {
    std::array<std::uint32_t, kMaxAtOnce> envs;
    std::uint64_t first = claimed.load(std::memory_order_relaxed), count = 0;
    do {
      const std::uint64_t last = pushed.load(std::memory_order_acquire);
      if (first >= last) return false;
      count = tasks_at_once(last - first);
      for (std::uint64_t i = 0; i < count; ++i)  // before the claim: once claimed, the entries may be written anew
        envs[i] = queue[(first + i) & mask].load(std::memory_order_relaxed);
    } while (!claimed.compare_exchange_weak(first, first + count, std::memory_order_acq_rel));
    for (std::uint64_t i = 0; i < count && !gone; ++i) run(envs[i], number, gone);
    return true;
  }

  void run(std::uint32_t env, std::size_t number, bool& gone) {
    std::atomic<std::uint64_t>& state = workers[number].state;
    state.store(at_work(env + 1, (state.load(std::memory_order_relaxed) >> 32) + 1), std::memory_order_release);
    task(env, number);
    std::uint64_t now = state.load(std::memory_order_relaxed);
    if (env_of(now) != kGivenUp && state.compare_exchange_strong(now, at_work(kNothing, now >> 32), std::memory_order_acq_rel))
      return complete(env, false);
    returned[env].store(true, std::memory_order_release);
    given_up.fetch_sub(1, std::memory_order_release);
    gone = true;
  }

  void work_until_stopped(std::size_t number) {
    for (bool gone = false; !gone;) {
      const std::uint32_t seen = wake.load(std::memory_order_acquire);
      if (stop.load(std::memory_order_acquire)) return;  // after `seen`, which the end changes: it cannot be slept through
      if (work(number, gone)) continue;
      for (int spin = 0; spin < kWorkerSpins && wake.load(std::memory_order_relaxed) == seen; ++spin) relax();
      wake.wait(seen, std::memory_order_acquire);
    }
    const std::scoped_lock lock(mutex);
    workers[number].state.store(0, std::memory_order_relaxed);
    free_numbers.push_back(number);
  }

  /// Under the mutex.  False: all numbers are taken.
  static bool start_thread(const std::shared_ptr<Shared>& self) {
    std::size_t number = self->workers_used.load();
    if (!self->free_numbers.empty()) {
      number = self->free_numbers.back();
      self->free_numbers.pop_back();
    } else if (number < self->workers.size()) {
      self->workers_used.store(number + 1);
    } else {
      return false;
    }
    self->threads.emplace_back(number, std::thread([self, number] { self->work_until_stopped(number); }));
    return true;
  }

  /// Gives up tasks that begin no stage for longer than the limit.
  void keep_watch(const std::shared_ptr<Shared>& self) {
    struct Seen {
      std::uint64_t state = 0;
      Clock::time_point since;
    };
    std::vector<Seen> seen(workers.size());
    const auto limit = std::chrono::duration<double>(stage_limit_s);
    std::unique_lock lock(mutex);
    while (!watch_wakes.wait_for(lock, limit / 8, [&] { return stop.load(); })) {
      const auto now = Clock::now();
      for (std::size_t number = 0; number < workers_used.load(); ++number) {
        std::uint64_t state = workers[number].state.load(std::memory_order_acquire);
        const std::uint32_t env = env_of(state);
        if (env == kNothing || env == kGivenUp || state != seen[number].state) {
          seen[number] = {state, now};
          continue;
        }
        if (now - seen[number].since <= limit) continue;
        given_up.fetch_add(1, std::memory_order_relaxed);
        if (!workers[number].state.compare_exchange_strong(state, at_work(kGivenUp, state >> 32), std::memory_order_acq_rel)) {
          given_up.fetch_sub(1, std::memory_order_relaxed);  // it has begun another stage, or is done
          continue;
        }
        for (auto& [worker_number, thread] : threads)
          if (worker_number == number) thread.detach();
        std::erase_if(threads, [&](const auto& item) { return item.first == number; });
        if (!start_thread(self) && threads.empty()) hopeless.store(true, std::memory_order_release);
        complete(env - 1, true);
      }
    }
  }
};

EnvWorkers::EnvWorkers(int threads, std::size_t num_envs, double stage_limit_s, Task task)
    : shared_(std::make_shared<Shared>(threads, num_envs, stage_limit_s, std::move(task))) {
  Shared& in = *shared_;
  in.caller_works = stage_limit_s <= 0;
  const std::scoped_lock lock(in.mutex);
  for (std::size_t number = in.caller_works ? 1 : 0; number < in.threads_wanted; ++number) Shared::start_thread(shared_);
  if (!in.caller_works) in.watch = std::thread([shared = shared_] { shared->keep_watch(shared); });
}

EnvWorkers::~EnvWorkers() {
  Shared& in = *shared_;
  std::vector<std::pair<std::size_t, std::thread>> threads;
  {
    const std::scoped_lock lock(in.mutex);
    in.stop.store(true);
    threads.swap(in.threads);
  }
  in.wake.fetch_add(1, std::memory_order_release);
  in.wake.notify_all();
  in.watch_wakes.notify_all();
  if (in.watch.joinable()) in.watch.join();
  for (auto& [number, thread] : threads) thread.join();
}

void EnvWorkers::run_in_background() {
  Shared& in = *shared_;
  if (!in.caller_works) return;
  const std::scoped_lock lock(in.mutex);
  if (!Shared::start_thread(shared_)) return;  // as many are there already as there may be
  in.caller_works = false;
}

void EnvWorkers::submit(std::span<const std::uint32_t> envs) {
  Shared& in = *shared_;
  std::uint64_t last = in.pushed.load(std::memory_order_relaxed);
  EARSHOT_EXPECT(num_under_way() + envs.size() <= in.queue.size());
  for (const std::uint32_t env : envs) in.queue[last++ & in.mask].store(env, std::memory_order_relaxed);
  in.submitted += envs.size();
  in.pushed.store(last, std::memory_order_release);
  in.wake.fetch_add(1, std::memory_order_release);
  in.wake.notify_all();
}

std::optional<CompletedEnv> EnvWorkers::done_already() {
  Shared& in = *shared_;
  std::atomic<std::uint64_t>& slot = in.done[in.received & in.mask];
  const std::uint64_t entry = slot.load(std::memory_order_acquire);
  if (entry == 0) return std::nullopt;
  slot.store(0, std::memory_order_relaxed);
  ++in.received;
  return CompletedEnv{.env = static_cast<std::uint32_t>((entry - 1) / 2), .stalled = (entry - 1) % 2 != 0};
}

CompletedEnv EnvWorkers::next() {
  Shared& in = *shared_;
  EARSHOT_EXPECT(num_under_way() > 0);
  for (int spin = 0;; ++spin) {
    if (const auto completed = done_already()) return *completed;
    if (in.hopeless.load(std::memory_order_acquire))
      throw RunError("environments", "too many stages are stuck and no thread is left; check the scenes named in the log");
    bool gone = false;
    if (in.caller_works && in.work(0, gone)) continue;
    if (spin < kWorkerSpins)
      relax();
    else  // until more have been completed than were received; an entry is written before it is counted
      in.completed.wait(static_cast<std::uint32_t>(in.received), std::memory_order_acquire);
  }
}

std::size_t EnvWorkers::num_under_way() const { return static_cast<std::size_t>(shared_->submitted - shared_->received); }
bool EnvWorkers::is_busy() const {
  const auto completed = shared_->completed.load(std::memory_order_acquire);  // first: what is submitted later is not done
  return completed != static_cast<std::uint32_t>(shared_->pushed.load(std::memory_order_acquire)) || tasks_given_up() > 0;
}
std::size_t EnvWorkers::num_workers() const { return shared_->workers.size(); }
bool EnvWorkers::beat(std::size_t worker) {
  if (shared_->stage_limit_s <= 0) return true;
  std::atomic<std::uint64_t>& state = shared_->workers[worker].state;
  std::uint64_t now = state.load(std::memory_order_relaxed);
  return env_of(now) != kGivenUp && state.compare_exchange_strong(now, now + (std::uint64_t{1} << 32), std::memory_order_acq_rel);
}
bool EnvWorkers::has_returned(std::size_t env) { return shared_->returned[env].exchange(false, std::memory_order_acq_rel); }
std::size_t EnvWorkers::tasks_given_up() const { return shared_->given_up.load(std::memory_order_acquire); }

}  // namespace earshot
