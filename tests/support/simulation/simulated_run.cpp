// SPDX-License-Identifier: Apache-2.0
#include "tests/support/simulation/simulated_run.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <map>
#include <optional>
#include <set>
#include <sstream>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/process/exit_codes.h"
#include "tests/support/simulation/link_faults.h"
#include "tests/support/simulation/simulated_network.h"
#include "trainer/collective/collective.h"
#include "trainer/collective/sum_order.h"
#include "trainer/collective/worker_updates.h"
#include "trainer/net/ring_config.h"
#include "trainer/net/wire.h"
#include "trainer/rollout/preemption.h"

namespace earshot::simulation {
namespace {

constexpr const char* kJoins = "joins";
constexpr double kLimit_s = 240;  // of simulated time: several timeouts after the last fault

/// Numbers in [-1, 1), which repeat after so many elements, no divisor of a segment.
std::vector<float> gradient_of(int rank, std::uint64_t update, int minibatch, std::size_t count) {
  constexpr std::size_t kPeriod = 257;
  Random random(hash64(fmt::format("{} {} {}", rank, update, minibatch)));
  std::vector<float> gradient(count);
  for (std::size_t i = 0; i < std::min(count, kPeriod); ++i)
    gradient[i] = static_cast<float>(static_cast<std::int32_t>(random.next() >> 32)) * 0x1p-31f;
  for (std::size_t i = kPeriod; i < count; ++i) gradient[i] = gradient[i - kPeriod];
  return gradient;
}

/// The sum in the order of sum_order.h, one element after another.
void add_reference(std::vector<float>& weights, const std::vector<int>& members, std::uint64_t update, int minibatch) {
  const std::size_t count = weights.size(), world = members.size();
  std::vector<std::vector<float>> parts;
  for (const int rank : members) parts.push_back(gradient_of(rank, update, minibatch, count));
  const bool small = count * sizeof(float) < kSmallSumBytes;
  for (std::size_t segment = 0; segment < world; ++segment)
    for (std::size_t i = segment_start(count, segment, world); i < segment_start(count, segment + 1, world); ++i) {
      const std::size_t first = small ? 0 : segment;
      float sum = parts[first][i];
      for (std::size_t k = 1; k < world; ++k) sum += parts[(first + k) % world][i];
      weights[i] += sum;
    }
}

std::uint64_t hash_of(const std::vector<float>& weights) { return hash64(std::as_bytes(std::span(weights))); }

/// Weights, and the hash after each update: where a worker has come from.
struct State {
  std::uint64_t update = 0;
  std::vector<float> weights;
  std::vector<std::uint64_t> history;

  [[nodiscard]] std::string encoded() const {
    std::string text(16 + 8 * history.size() + 4 * weights.size(), '\0');
    const std::uint64_t lengths[2] = {update, weights.size()};
    std::memcpy(text.data(), lengths, 16);
    std::memcpy(text.data() + 16, history.data(), 8 * history.size());
    std::memcpy(text.data() + 16 + 8 * history.size(), weights.data(), 4 * weights.size());
    return text;
  }
  void decode(const std::string& text) {
    std::uint64_t lengths[2];
    std::memcpy(lengths, text.data(), 16);
    update = lengths[0];
    history.resize(update);
    weights.resize(lengths[1]);
    std::memcpy(history.data(), text.data() + 16, 8 * update);
    std::memcpy(weights.data(), text.data() + 16 + 8 * update, 4 * weights.size());
  }
};

std::vector<int> all_ranks(int count) {
  std::vector<int> ranks;
  for (int rank = 0; rank < count; ++rank) ranks.push_back(rank);
  return ranks;
}

/// What all workers do, seen from outside.
class Checker {
 public:
  Checker(const Scenario& scenario, RunReport& report) : scenario_(scenario), report_(report) {}

  void fail(const std::string& what) {
    if (report_.failures.size() < 10) report_.failures.push_back(what);
  }

  /// A worker has these members from now on.
  void note_members(const Process& process, const std::vector<int>& members, const std::vector<int>& lost, const std::vector<int>& joined) {
    const int rank = process.rank;
    members_[&process] = members;
    ++report_.changes;
    report_.joins += static_cast<int>(joined.size());
    if (std::ranges::find(members, rank) == members.end()) fail(fmt::format("rank {} is no member of its own view {}", rank, members));
    for (const int left : lost)
      if (std::ranges::find(members, left) != members.end() && std::ranges::find(joined, left) == joined.end())
        fail(fmt::format("rank {} has lost {}, a member", rank, left));
  }

  /// Workers of one epoch have the same members.
  void note_message(const Process& process, const Message& message) {
    const int rank = process.rank;
    if (message.size() != 2 || message[0]->length() != kHeaderBytes) return;
    const FrameHeader header = decode_header({static_cast<const std::byte*>(message[0]->data()), kHeaderBytes});
    if (header.operation == Operation::view || header.operation == Operation::goodbye || header.operation == Operation::progress) return;
    const auto own = members_.find(&process);
    const std::vector<int> everyone = all_ranks(scenario_.world_size), &members = own == members_.end() ? everyone : own->second;
    const auto [first, is_new] = members_of_epoch_.try_emplace(header.epoch, members);
    if (first->second != members)
      fail(fmt::format("epoch {} has members {} and, as rank {} knows, {}", header.epoch, first->second, rank, members));
    if (std::ranges::find(members, rank) == members.end())
      fail(fmt::format("rank {} sends in epoch {} of {}", rank, header.epoch, members));
  }
  void note_update(int rank, const std::vector<int>& members, const State& before, const State& after, double now_s) {
    const std::uint64_t hash = hash_of(after.weights);
    auto key = std::make_pair(before.history, members);
    auto found = expected_.find(key);
    if (found == expected_.end()) {
      State reference = before;
      for (int minibatch = 0; minibatch < scenario_.minibatches; ++minibatch)
        add_reference(reference.weights, members, before.update, minibatch);
      found = expected_.emplace(std::move(key), hash_of(reference.weights)).first;
    }
    if (hash != found->second) fail(fmt::format("update {} of rank {} is not the sum over {}", after.update, rank, members));
    const auto parent = before.history.empty() ? 0 : before.history.back();
    if (hash_of(before.weights) != parent && before.update > 0)
      fail(fmt::format("rank {} begins update {} from other weights", rank, after.update));
    if (last_update_s_ > 0 && after.update > highest_) report_.longest_gap_s = std::max(report_.longest_gap_s, now_s - last_update_s_);
    if (after.update > highest_) {
      highest_ = after.update;
      last_update_s_ = now_s;
    }
  }
  /// Rank 0 has written it to the disk.
  void note_checkpoint(const State& state) { checkpoints_.push_back(state.history); }
  void note_finished(int rank, const State& state) {
    ++report_.finished;
    if (state.update != static_cast<std::uint64_t>(scenario_.updates))
      fail(fmt::format("rank {} finishes with {} updates of {}", rank, state.update, scenario_.updates));
    if (final_ && *final_ != state.history) fail(fmt::format("rank {} finishes with other bits", rank));
    final_ = state.history;
  }
  void check_end() {
    for (const auto& history : checkpoints_)
      if (final_ && (history.size() > final_->size() || !std::equal(history.begin(), history.end(), final_->begin())))
        fail(fmt::format("the checkpoint of update {} is not of the run that finished", history.size()));
    for (const auto& a : checkpoints_)
      for (const auto& b : checkpoints_)
        if (!std::equal(a.begin(), a.begin() + static_cast<std::ptrdiff_t>(std::min(a.size(), b.size())), b.begin()))
          fail(fmt::format("the checkpoints of updates {} and {} are of different runs", a.size(), b.size()));
  }
  [[nodiscard]] std::uint64_t highest() const { return highest_; }

 private:
  const Scenario& scenario_;
  RunReport& report_;
  std::map<const Process*, std::vector<int>> members_;  ///< of those that have joined or lost others
  std::map<std::uint32_t, std::vector<int>> members_of_epoch_;
  std::map<std::pair<std::vector<std::uint64_t>, std::vector<int>>, std::uint64_t> expected_;
  std::vector<std::vector<std::uint64_t>> checkpoints_;
  std::optional<std::vector<std::uint64_t>> final_;
  std::uint64_t highest_ = 0;
  double last_update_s_ = 0;
};

RingConfig config_of(const Scenario& scenario, int rank) {
  RingConfig config;
  config.identity = {rank, scenario.world_size};
  config.rendezvous = "tcp://127.0.0.1:29000";
  config.run_id = "simulated";
  config.timeout = std::chrono::milliseconds(static_cast<std::int64_t>(1000 * scenario.timeout_s));
  config.network.shared_memory = false;
  config.network.on_loss = OnLoss::go_on;
  config.network.progress_timeout_s = scenario.progress_timeout_s;
  config.engine = "engine";
  config.settings = "a=1\nb=2\n";
  return config;
}

/// A training run without a network or environments: the calls are those of TrainWorker and PpoLearner, in their order, and the recovery
/// is that of Recovery.
class Worker {
 public:
  Worker(const Scenario& scenario, Network& network, Checker& checker, int rank, bool joins)
      : scenario_(scenario),
        network_(network),
        checker_(checker),
        rank_(rank),
        collective_(joins ? make_joining_worker(config_of(scenario, rank)) : make_zmq_ring(config_of(scenario, rank))),
        preemption_(ppo_of(scenario), scenario.rollout_steps),
        joins_(joins) {}

  void run() {
    if (joins_) {
      pause(3);
      collective_->enter();
      recover(MembershipChange({}));
    } else {
      start();
    }
    for (bool done = false; !done;) try {
        while (!agree_on_end()) {
          if (has_joiners_) collective_->admit();
          update();
        }
        save();
        collective_->barrier();
        done = true;
      } catch (const MembershipChange& change) {
        recover(change);
      }
    if (alive()) checker_.note_finished(rank_, state_);
  }

 private:
  static PpoConfig ppo_of(const Scenario& scenario) {
    PpoConfig ppo;
    ppo.preempt_fraction = scenario.preempt_fraction;
    ppo.preempt_least = 0.25;
    return ppo;
  }
  [[nodiscard]] bool alive() const { return network_.running()->alive; }
  [[nodiscard]] double now_s() const { return static_cast<double>(network_.now()) * 1e-9; }
  /// Work that takes so long.
  void pause(double milliseconds) {
    const Nanos until = network_.now() + static_cast<Nanos>(milliseconds * kMilli) * network_.running()->slowness;
    while (network_.now() < until) network_.wait(until);
  }

  void start() {
    try {
      state_.weights.assign(scenario_.elements, 0.5f);
      check_equal_weights();
      brief();
    } catch (const MembershipChange& change) {
      throw WorldLost("start of the run", change.what());
    }
  }

  bool agree_on_end() {
    std::array<double, 2> votes{state_.update >= static_cast<std::uint64_t>(scenario_.updates) ? 1.0 : 0.0,
                                collective_->has_joiners() ? 1.0 : 0.0};
    collective_->all_reduce_sum(std::span<double>(votes));
    has_joiners_ = votes[1] > 0;
    return votes[0] > 0;
  }

  void collect() {
    const double began_s = now_s();
    steps_ = 0;
    while (steps_ < scenario_.rollout_steps) {
      pause(scenario_.step_ms * (0.7 + 0.3 * static_cast<double>(network_.random().between(0, 2))));
      collective_->note_progress();
      const int step = steps_++;
      if (preemption_.may_end_with(step) &&
          preemption_.ends_with(step, now_s() - began_s, collective_->num_waiting(), collective_->identity().world_size))
        break;
    }
    collect_s_ = now_s() - began_s;
    has_rollout_ = true;
  }

  void update() {
    if (!has_rollout_) collect();
    if (preemption_.is_on()) collective_->all_gather(std::to_string(steps_));
    const std::vector<int> members = collective_->members();
    whole_ = state_;
    learning_ = true;
    for (int minibatch = 0; minibatch < scenario_.minibatches; ++minibatch) {
      std::vector<double> counts{1, static_cast<double>(rank_)};
      collective_->all_reduce_sum(std::span<double>(counts));
      if (counts[0] != static_cast<double>(members.size()))
        checker_.fail(fmt::format("rank {} counts {} of {} workers", rank_, counts[0], members.size()));
      std::vector<float> gradient = gradient_of(rank_, state_.update, minibatch, scenario_.elements);
      pause(1);
      collective_->note_progress();
      collective_->all_reduce_sum(std::span<float>(gradient));
      for (std::size_t i = 0; i < gradient.size(); ++i) state_.weights[i] += gradient[i] * (rank_ == scenario_.adds_twice ? 2.f : 1.f);
    }
    learning_ = false;
    has_rollout_ = false;
    ++state_.update;
    state_.history.push_back(hash_of(state_.weights));
    if (alive()) checker_.note_update(rank_, members, *whole_, state_, now_s());
    brief();
    std::vector<RolloutTime> rollouts;
    WorkerUpdate mine{};
    mine.collect_s = collect_s_;
    mine.rollout_steps = steps_;
    for (const WorkerUpdate& worker : gather_worker_updates(*collective_, mine))
      rollouts.push_back({worker.collect_s, static_cast<int>(worker.rollout_steps)});
    preemption_.note_update(rollouts);
    if (state_.update == 1 || state_.update % 2 == 0) save();
  }

  void check_equal_weights() {
    const std::string hash = std::to_string(hash_of(state_.weights));
    for (const auto& other : collective_->all_gather(hash))
      if (other != hash) throw RunError("workers", "have different weights");
  }
  void save() {
    check_equal_weights();
    if (collective_->identity().rank == 0 && alive()) checker_.note_checkpoint(state_);
  }
  void brief() {
    if (!collective_->is_joining()) collective_->brief(fmt::format("update {}", state_.update));
  }

  void recover(const MembershipChange& change) {
    if (!collective_->is_joining()) checker_.note_members(*network_.running(), collective_->members(), change.lost(), change.joined());
    while (true) try {
        if (agree_on_state()) break;
        collective_->barrier();
      } catch (const MembershipChange& next) {
        checker_.note_members(*network_.running(), collective_->members(), next.lost(), next.joined());
      }
    brief();
  }

  bool agree_on_state() {
    std::vector<int> joining;
    int source = -1;
    std::uint64_t last = UINT64_MAX;
    const auto of_all = collective_->all_gather(joins_ ? std::string(kJoins) : std::to_string(state_.update));
    for (std::size_t place = 0; place < of_all.size(); ++place) {
      if (of_all[place] == kJoins) {
        joining.push_back(static_cast<int>(place));
        continue;
      }
      if (source < 0) source = static_cast<int>(place);
      last = std::min<std::uint64_t>(last, std::stoull(of_all[place]));
    }
    if (source < 0) throw WorldLost("workers", "all workers with the state of the run are lost; continue with --resume");
    if (!joins_ && (state_.update > last || learning_)) {
      if (!whole_ || whole_->update != last)
        throw RunError("workers", fmt::format("are at updates {} and {}, which is too far apart", last, state_.update));
      state_ = *whole_;
    }
    learning_ = false;
    if (!joining.empty()) {
      const bool is_source = collective_->identity().rank == source;
      const std::string bytes = collective_->hand_over(source, joining, is_source ? state_.encoded() : std::string());
      if (joins_) state_.decode(bytes);
    }
    const std::string hash = std::to_string(hash_of(state_.weights));
    for (const auto& other : collective_->all_gather(hash))
      if (other != hash) throw RunError("workers", "have different weights");
    if (std::exchange(joins_, false)) collective_->confirm_join();
    return true;
  }

  const Scenario& scenario_;
  Network& network_;
  Checker& checker_;
  int rank_;
  std::unique_ptr<Collective> collective_;
  Preemption preemption_;
  State state_;
  std::optional<State> whole_;
  int steps_ = 0;
  double collect_s_ = 0;
  bool joins_, learning_ = false, has_rollout_ = false, has_joiners_ = false;
};

/// Errors that say that the workers misunderstood each other: no fault of a process or a link may lead to them.
bool is_misunderstanding(const std::string& error) {
  for (const char* text : {"breaks the protocol", "but this worker is at", "is expected", "wrong part", "wrong order",
                           "start all workers with", "internal error", "different weights", "too far apart",
                           "while this worker is still sending", "another protocol", "does not return its buffers", "ZeroMQ"})
    if (error.find(text) != std::string::npos) return true;
  return false;
}

}  // namespace

RunReport run_scenario(const Scenario& scenario) {
  RunReport report;
  Checker checker(scenario, report);
  {
    Network network(scenario.seed);
    network.set_latency(scenario.least_latency_us * kMicro, scenario.most_latency_us * kMicro);
    const Nanos began = network.now();
    network.on_send = [&](const Process& process, const Message& message) { checker.note_message(process, message); };
    int num_kills = 0, num_errors = 0;
    report.must_go_on = true;
    const auto at = [&](double seconds, std::function<void()> action) {
      network.at(began + static_cast<Nanos>(seconds * 1e9), std::move(action));
    };
    std::vector<Process*> current(static_cast<std::size_t>(scenario.world_size), nullptr);
    int running = 0, pending = 0;
    std::function<void(int, bool)> launch = [&](int rank, bool joins) {
      ++running;
      const auto index = static_cast<std::size_t>(rank);
      Process& process = network.start(rank, scenario.slowness[index], [&, rank, joins] {
        std::string outcome = "finished";
        try {
          Worker(scenario, network, checker, rank, joins).run();
        } catch (const ProcessKilled&) {
          outcome = "killed";
        } catch (const LeftOut& error) {
          outcome = fmt::format("left out: {}", error.what());
          num_errors += joins ? 0 : 1;
        } catch (const std::exception& error) {
          outcome = error.what();
          if (network.running()->alive && !joins) ++num_errors;
          if (network.running() != nullptr && network.running()->alive && is_misunderstanding(outcome))
            checker.fail(fmt::format("rank {}: {}", rank, outcome));
          const bool may_start_again =
              dynamic_cast<const WorldLost*>(&error) != nullptr || dynamic_cast<const WorldIncomplete*>(&error) != nullptr;
          if (network.running() != nullptr && network.running()->alive && !joins && !may_start_again)
            checker.fail(fmt::format("rank {} ends as failed by itself: {}", rank, outcome));
        }
        if (!network.running()->alive) outcome = "killed";
        report.outcomes.push_back(fmt::format("{:.4f} s: rank {}{} {}", static_cast<double>(network.now() - began) * 1e-9, rank,
                                              joins ? " (joined)" : "", outcome));
        --running;
      });
      process.on_death = [&] {
        if (!process.has_begun) --running;
        ++num_kills;
        if (process.dark) report.must_go_on = false;
        if (checker.highest() == 0) report.must_go_on = false;
      };
      current[index] = &process;
    };
    for (int rank = 0; rank < scenario.world_size; ++rank)
      at(rank == 0 ? 0.001 : 0.0001 * static_cast<double>(network.random().between(0, 30)), [&, rank] { launch(rank, false); });
    pending += scenario.world_size;
    for (int rank = 0; rank < scenario.world_size; ++rank) at(0.0031, [&] { --pending; });
    for (const Fault& fault : scenario.faults) {
      if (fault.kind != Fault::Kind::kill) report.must_go_on = false;
      const auto index = static_cast<std::size_t>(fault.rank);
      const auto restart_after = [&, fault](Process& process) {
        if (fault.restart_s < 0) return;
        const auto before = process.on_death;
        process.on_death = [&, before, fault] {
          if (before) before();
          ++pending;
          network.at(network.now() + static_cast<Nanos>(fault.restart_s * 1e9), [&, fault] {
            --pending;
            launch(fault.rank, true);
          });
        };
      };
      at(fault.after_messages >= 0 ? 0.0031 : std::max(0.0031, fault.at_s), [&, fault, index, restart_after] {
        Process& process = *current[index];
        const auto lasts = static_cast<Nanos>(fault.duration_s * 1e9);
        switch (fault.kind) {
          case Fault::Kind::kill:
          case Fault::Kind::power_off:
            if (process.fiber->has_ended() || !process.alive) return;
            restart_after(process);
            if (fault.after_messages >= 0)
              process.dies_after_messages = fault.after_messages;
            else
              network.kill(process, fault.kind == Fault::Kind::power_off);
            return;
          case Fault::Kind::stop:
            return network.stop(process, lasts);
          case Fault::Kind::hang:
            return network.hang(process, lasts);
          default:
            return inflict_on_links(network, fault, scenario.world_size);
        }
      });
    }
    network.run(began + static_cast<Nanos>(kLimit_s * 1e9), [&] { return running == 0 && pending == 0; });
    if (running > 0) checker.fail(fmt::format("{} processes have not ended after {} s", running, kLimit_s));
    report.messages = network.num_messages();
    checker.check_end();
    report.must_go_on = report.must_go_on && 2 * num_kills < scenario.world_size;
    if (report.must_go_on && num_errors > 0) checker.fail("workers end though a majority was left");
    if (report.must_go_on && report.longest_gap_s > 2 + scenario.update_s())
      checker.fail(fmt::format("the run stood still for {:.2f} s", report.longest_gap_s));
  }
  return report;
}

}  // namespace earshot::simulation
