// SPDX-License-Identifier: Apache-2.0
#include "sim/base/process/stop_signals.h"

#include <atomic>
#include <csignal>
#include <cstddef>
#include <tuple>

namespace earshot {
namespace {

constexpr std::array<int, 4> kSignals{SIGTERM, SIGINT, SIGHUP, SIGUSR1};

// A signal handler may only touch a lock-free atomic; it has to be reachable without an argument.
std::atomic<int> stop_signal{0};
static_assert(std::atomic<int>::is_always_lock_free);

void request_stop(int signal) {
  int no_signal = 0;
  stop_signal.compare_exchange_strong(no_signal, signal);
}

}  // namespace

StopSignals::StopSignals() {
  static_assert(kSignals.size() == std::tuple_size_v<decltype(previous_)>);
  stop_signal.store(0);
  for (std::size_t i = 0; i < kSignals.size(); ++i) {
    previous_[i] = std::signal(kSignals[i], request_stop);
    if (kSignals[i] == SIGHUP && previous_[i] == SIG_IGN) std::signal(SIGHUP, SIG_IGN);  // nohup
  }
}

StopSignals::~StopSignals() {
  for (std::size_t i = 0; i < kSignals.size(); ++i) std::signal(kSignals[i], previous_[i]);
}

int StopSignals::signal() { return stop_signal.load(); }

}  // namespace earshot
