// SPDX-License-Identifier: Apache-2.0
#include "trainer/launch/worker_group.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <functional>
#include <memory>
#include <system_error>
#include <utility>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/process/exit_codes.h"
#include "sim/base/temporary_folder.h"
#include "trainer/launch/transport.h"
#include "trainer/launch/worker_names.h"
#include "trainer/net/curve_keys.h"
#include "trainer/net/host_address.h"
#include "trainer/net/rendezvous.h"
#include "trainer/net/ring_config.h"

extern char** environ;

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::minutes kCollectiveTimeout(10);
constexpr std::chrono::milliseconds kShortHeartbeat(150);  // four and one until the next: a stopped worker is noticed within 1 s
constexpr std::chrono::minutes kLastWorkerGrace(1);        // for the last checkpoint, once the first worker has ended

/// Holds back the signals that the parent waits for; the old mask comes back at the end.
class BlockedSignals {
 public:
  BlockedSignals() {
    sigemptyset(&set_);
    for (const int signal : {SIGCHLD, SIGINT, SIGTERM, SIGHUP, SIGUSR1}) sigaddset(&set_, signal);
    sigprocmask(SIG_BLOCK, &set_, &previous_);
    previous_child_ = ::signal(SIGCHLD, SIG_DFL);  // ignored, it would take the exit codes away
  }
  ~BlockedSignals() {
    ::signal(SIGCHLD, previous_child_);
    sigprocmask(SIG_SETMASK, &previous_, nullptr);
  }
  BlockedSignals(const BlockedSignals&) = delete;
  BlockedSignals& operator=(const BlockedSignals&) = delete;
  [[nodiscard]] const sigset_t& previous() const { return previous_; }

  /// The next signal, or 0 after the timeout.
  siginfo_t wait(std::chrono::milliseconds timeout) const {
    siginfo_t info{};
    const timespec limit{timeout.count() / 1000, timeout.count() % 1000 * 1000000};
    if (sigtimedwait(&set_, &info, &limit) < 0) info.si_signo = 0;
    return info;
  }

 private:
  sigset_t set_{}, previous_{};
  sighandler_t previous_child_ = SIG_DFL;
};

/// argv or envp for execve: built before the fork, since only async-signal-safe calls are allowed between fork and exec.
class CStrings {
 public:
  explicit CStrings(std::vector<std::string> strings) : strings_(std::move(strings)) {
    for (auto& text : strings_) pointers_.push_back(text.data());
    pointers_.push_back(nullptr);
  }
  [[nodiscard]] char* const* get() const { return pointers_.data(); }

 private:
  std::vector<std::string> strings_;
  std::vector<char*> pointers_;
};

/// Whether the two say "NAME=" of the same name.
bool same_name(std::string_view a, std::string_view b) { return a.substr(0, a.find('=')) == b.substr(0, b.find('=')); }

std::vector<std::string> environment_of(int rank, int num_workers, const std::string& rendezvous, const std::string& run_id,
                                        const std::vector<std::string>& handed) {
  std::vector<std::string> variables = handed;
  bool omp = false, openblas = false;
  for (char** variable = environ; *variable != nullptr; ++variable) {
    const std::string_view text = *variable;
    const std::string_view name = text.substr(0, text.find('='));
    if (std::ranges::any_of(handed, [&](const std::string& other) { return same_name(text, other); })) continue;
    if (name == kRankName || name == kWorldSizeName || name == kRendezvousName || name == kRunIdName) continue;
    omp = omp || name == "OMP_NUM_THREADS";
    openblas = openblas || name == "OPENBLAS_NUM_THREADS";
    variables.emplace_back(text);
  }
  if (!omp) variables.emplace_back("OMP_NUM_THREADS=1");
  if (!openblas) variables.emplace_back("OPENBLAS_NUM_THREADS=1");
  variables.push_back(fmt::format("{}={}", kRankName, rank));
  variables.push_back(fmt::format("{}={}", kWorldSizeName, num_workers));
  variables.push_back(fmt::format("{}={}", kRendezvousName, rendezvous));
  variables.push_back(fmt::format("{}={}", kRunIdName, run_id));
  return variables;
}

struct Worker {
  int rank = 0;
  pid_t pid = 0;
  bool joins = false;  ///< was started again
  bool running = true, stopped = false;
};

/// The workers of one run; kills what is left when it goes.
class WorkerGroup {
 public:
  /// again: starts a lost worker of that rank again.
  WorkerGroup(const BlockedSignals& signals, std::chrono::milliseconds grace, OnLoss on_loss, int restarts,
              const std::vector<int>& descriptors, std::function<void(int)> again)
      : signals_(signals), grace_(grace), on_loss_(on_loss), restarts_(restarts), descriptors_(descriptors), again_(std::move(again)) {}
  ~WorkerGroup() {
    send(SIGKILL);
    for (Worker& worker : workers_)
      if (worker.running) ::waitpid(worker.pid, nullptr, 0);
  }
  WorkerGroup(const WorkerGroup&) = delete;
  WorkerGroup& operator=(const WorkerGroup&) = delete;

  void start(int rank, const CStrings& arguments, const CStrings& environment, bool joins = false) {
    const pid_t parent = ::getpid();
    const pid_t pid = ::fork();
    if (pid < 0) throw RunError(worker_name(rank), fmt::format("cannot be started: {}", std::strerror(errno)));
    if (pid == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      if (::getppid() != parent) ::_exit(1);  // the parent died before prctl took effect
      ::sigprocmask(SIG_SETMASK, &signals_.previous(), nullptr);
      for (const int descriptor : descriptors_) ::fcntl(descriptor, F_SETFD, 0);
      ::execve("/proc/self/exe", arguments.get(), environment.get());
      ::_exit(127);
    }
    workers_.push_back({rank, pid, joins});
  }

  /// Waits for all; returns the exit code of the run.
  int wait() {
    while (reap()) {
      const bool stopping = kill_at_ != Clock::time_point::max();
      if (Clock::now() >= kill_at_) send(SIGKILL);
      // SIGCHLD may stand for several children and wakes at once; the timeout serves the grace time.
      const siginfo_t info = signals_.wait(std::chrono::milliseconds(stopping ? 100 : 1000));
      if (info.si_signo != 0 && info.si_signo != SIGCHLD) pass_on(info);
    }
    if (exit_code_ == kExitDone && lost_ && !succeeded_) return kExitLostWorld;  // none is left
    return exit_code_ == kExitDone ? orderly_code_ : exit_code_;
  }

 private:
  void send(int signal) const {
    for (const Worker& worker : workers_)
      if (worker.running) ::kill(worker.pid, signal);
  }

  void pass_on(const siginfo_t& info) {
    const bool ends = info.si_signo == SIGINT || info.si_signo == SIGTERM;
    if (ends && asked_to_end_) {
      stop();
      return;
    }
    asked_to_end_ = asked_to_end_ || ends;
    // A terminal's Ctrl-C reaches the workers by itself: they are in the same process group.
    if (info.si_code != SI_KERNEL) send(info.si_signo);
  }

  void stop() {
    if (kill_at_ != Clock::time_point::max()) return;
    send(SIGTERM);
    send(SIGCONT);  // a stopped worker could not die of SIGTERM
    kill_at_ = Clock::now() + grace_;
  }

  /// Collects those that have ended; false when none is left.
  bool reap() {
    bool running = false;
    for (Worker& worker : workers_) {
      int status = 0;
      if (worker.running && ::waitpid(worker.pid, &status, WNOHANG | WUNTRACED | WCONTINUED) == worker.pid) {
        worker.stopped = WIFSTOPPED(status);
        worker.running = WIFSTOPPED(status) || WIFCONTINUED(status);
        if (!worker.running) ended(worker, status);
      }
      running = running || worker.running;
    }
    for (const int rank : std::exchange(lost_ranks_, {})) try {
        again_(rank);
        running = true;
      } catch (const RunError& error) {  // no process to be had: the others go on
        say(fmt::format("{}\n", error.what()));
      }
    stop_lost_workers();
    return running;
  }

  /// Once a worker has made the run to its end, those that the run went on without.
  void stop_lost_workers() {
    if (!succeeded_ || on_loss_ != OnLoss::go_on || kill_at_ != Clock::time_point::max()) return;
    const bool only_stopped = std::ranges::all_of(workers_, [](const Worker& worker) { return !worker.running || worker.stopped; });
    if (only_stopped || Clock::now() - succeeded_at_ > kLastWorkerGrace) kill_at_ = Clock::now();
  }

  void ended(const Worker& worker, int status) {
    const int rank = worker.rank;
    if (WIFEXITED(status) && is_orderly_end(WEXITSTATUS(status))) {
      orderly_code_ = std::max(orderly_code_, WEXITSTATUS(status));
      if (!std::exchange(succeeded_, true)) succeeded_at_ = Clock::now();
      return;
    }
    const bool lost = WIFSIGNALED(status) || WEXITSTATUS(status) == kExitLostWorld || worker.joins;
    if (on_loss_ == OnLoss::go_on && lost && (succeeded_ || kill_at_ == Clock::time_point::max())) {
      lost_ = true;
      if (succeeded_) return;
      const bool again = restarts_ > 0 && !asked_to_end_ && (WIFSIGNALED(status) || WEXITSTATUS(status) == kExitLostWorld);
      const char* const then = again ? "; restarting it" : "";
      if (WIFSIGNALED(status))
        say(fmt::format("worker {}: was killed by signal {} ({}); the other workers continue{}\n", rank, WTERMSIG(status),
                        ::strsignal(WTERMSIG(status)), then));
      else
        say(fmt::format("worker {}: exited with code {}; the other workers continue{}\n", rank, WEXITSTATUS(status), then));
      if (!again) return;
      --restarts_;
      lost_ranks_.push_back(rank);
      return;
    }
    note_failure(rank, status);
    stop();
  }

  /// The first failure is named.  One that was due to the loss of others is not the run's if another comes to be known.
  void note_failure(int rank, int status) {
    const bool is_first = exit_code_ == kExitDone;
    if (is_first && WIFSIGNALED(status))
      say(fmt::format("worker {}: was killed by signal {} ({}); the run ends\n", rank, WTERMSIG(status), ::strsignal(WTERMSIG(status))));
    if (is_first && WIFEXITED(status)) say(fmt::format("worker {}: exited with code {}; the run ends\n", rank, WEXITSTATUS(status)));
    const bool by_us = kill_at_ != Clock::time_point::max() && WIFSIGNALED(status);
    if (!by_us && (is_first || exit_code_ == kExitLostWorld)) exit_code_ = code_of(status);
    if (is_first && by_us) exit_code_ = kExitFailed;
  }

  [[nodiscard]] int code_of(int status) const {
    if (WIFEXITED(status)) return WEXITSTATUS(status);
    constexpr std::array from_outside{SIGKILL, SIGTERM, SIGHUP, SIGINT, SIGUSR1};
    const bool is_loss = !asked_to_end_ && std::ranges::find(from_outside, WTERMSIG(status)) != from_outside.end();
    return is_loss ? kExitLostWorld : kExitFailed;
  }

  /// Where the output is closed the run goes on.
  static void say(const std::string& line) { std::fputs(line.c_str(), stderr); }

  const BlockedSignals& signals_;
  std::chrono::milliseconds grace_;
  std::vector<Worker> workers_;
  Clock::time_point kill_at_ = Clock::time_point::max();  ///< end of the grace time, once the group is being stopped
  bool asked_to_end_ = false;
  OnLoss on_loss_;
  int restarts_;  ///< that are left
  const std::vector<int>& descriptors_;
  std::function<void(int)> again_;
  std::vector<int> lost_ranks_;            ///< to be started again
  bool succeeded_ = false, lost_ = false;  ///< a worker has succeeded, or was lost
  Clock::time_point succeeded_at_;
  int exit_code_ = kExitDone;     ///< of a failure
  int orderly_code_ = kExitDone;  ///< of those that have ended in order
};

}  // namespace

std::optional<LaunchedWorker> worker_from_environment(const NetworkConfig& network) {
  const PortRange ports = ports_of(network);
  const Variables variables = launcher_variables();
  auto worker = ports.first > 0 ? worker_from(variables, ports.first, ports.last, network.collective)
                                : worker_from(variables, 20000, 29999, network.collective);
  if (!worker) return std::nullopt;
  worker->ring.network = network;
  worker->ring.timeout = kCollectiveTimeout;
  if (network.on_loss == OnLoss::go_on) worker->ring.heartbeat = kShortHeartbeat;
  validate_world(worker->ring.identity.world_size, network.on_loss);
  ChosenTransport chosen = choose_transport(network, worker->ring.identity.world_size, worker->has_pmix);
  worker->ring.network.collective = chosen.transport;
  worker->transport_reason = std::move(chosen.reason);
  if (chosen.transport == Transport::mpi) return worker;  // which has no use for a rendezvous
  worker->made_folder = std::make_shared<MeetingFolder>(worker->folder, worker->ring.identity.rank);
  if (chosen.transport == Transport::gloo) return worker;
  validate(worker->ring);
  const std::string& rendezvous = worker->ring.rendezvous;
  const bool is_local = rendezvous.starts_with("tcp://") && is_loopback(parse_tcp(rendezvous).host);
  if (is_local && worker->ring.identity.world_size > 1 && network.curve_key_file.empty() && !network.insecure && has_curve()) {
    worker->run_key = std::make_shared<RunKey>(worker->ring.run_id, rendezvous);
    worker->ring.network.curve_key_file = worker->run_key->file().string();
  }
  return worker;
}

int spawn_workers(int num_workers, const std::vector<std::string>& arguments, std::chrono::milliseconds grace, OnLoss on_loss, int restarts,
                  const Handed& handed) {
  validate_world(num_workers, on_loss);
  std::vector<std::string> line{std::filesystem::read_symlink("/proc/self/exe").string()};
  line.insert(line.end(), arguments.begin(), arguments.end());
  const CStrings argv(line);
  line.emplace_back("--join");
  const CStrings joining_argv(std::move(line));

  const TemporaryFolder folder(parent_of_sockets(), "earshot-");
  const std::string rendezvous = fmt::format("ipc://{}", (folder.path() / "meet").string());
  const std::string run_id = hex64(hash64(folder.path().string(), static_cast<std::uint64_t>(::getpid())));
  const BlockedSignals signals;
  WorkerGroup* started = nullptr;
  const auto environment = [&](int rank) { return CStrings(environment_of(rank, num_workers, rendezvous, run_id, handed.variables)); };
  WorkerGroup group(signals, grace, on_loss, restarts, handed.descriptors,
                    [&](int rank) { started->start(rank, joining_argv, environment(rank), true); });
  started = &group;
  for (int rank = 0; rank < num_workers; ++rank) group.start(rank, argv, environment(rank));
  return group.wait();
}

}  // namespace earshot
