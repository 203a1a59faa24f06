// SPDX-License-Identifier: Apache-2.0
#include "trainer/collective/mpi/mpi_exchange.h"

#include "sim/base/errors.h"

#ifdef EARSHOT_MPI
#include <fmt/format.h>
#include <mpi.h>
#include <sched.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <deque>
#include <exception>
#include <limits>
#include <optional>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include "sim/base/process/exit_codes.h"
#include "sim/base/text/listed.h"
#endif

namespace earshot {

#ifdef EARSHOT_MPI
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr milliseconds kBetweenNews{100}, kBetweenSigns{1000}, kGrace{500};
constexpr int kYields = 20;  // looks of a waiting worker before it sleeps between them
constexpr int kLongestSleep_us = 5000;

void check(int code, const char* call) {
  if (code == MPI_SUCCESS) return;
  char text[MPI_MAX_ERROR_STRING] = {};
  int length = 0;
  MPI_Error_string(code, text, &length);
  throw RunError("MPI", fmt::format("{}: {}", call, std::string_view(text, static_cast<std::size_t>(length))));
}

/// MPI from MPI_Init_thread to MPI_Finalize; the latter only where all is well.
class MpiLibrary {
 public:
  MpiLibrary() {
    int level = 0;
    check(MPI_Init_thread(nullptr, nullptr, MPI_THREAD_SERIALIZED, &level), "MPI_Init_thread");
    if (level < MPI_THREAD_SERIALIZED)
      throw InputError("network.collective = mpi", "this MPI allows calls from the first thread only", "install Debian's libopenmpi3");
  }
  ~MpiLibrary() {
    if (is_whole) MPI_Finalize();
  }
  MpiLibrary(const MpiLibrary&) = delete;
  MpiLibrary& operator=(const MpiLibrary&) = delete;
  bool is_whole = true;
};

/// A communicator of its own, so that no message meets those of others.
class Communicator {
 public:
  explicit Communicator(const MpiLibrary& library) : library_(library) {
    check(MPI_Comm_dup(MPI_COMM_WORLD, &handle_), "MPI_Comm_dup");
    check(MPI_Comm_set_errhandler(handle_, MPI_ERRORS_RETURN), "MPI_Comm_set_errhandler");
  }
  ~Communicator() {
    if (library_.is_whole) MPI_Comm_free(&handle_);
  }
  Communicator(const Communicator&) = delete;
  Communicator& operator=(const Communicator&) = delete;
  [[nodiscard]] MPI_Comm get() const { return handle_; }
  [[nodiscard]] WorkerIdentity identity() const {
    WorkerIdentity identity;
    check(MPI_Comm_rank(handle_, &identity.rank), "MPI_Comm_rank");
    check(MPI_Comm_size(handle_, &identity.world_size), "MPI_Comm_size");
    return identity;
  }

 private:
  const MpiLibrary& library_;
  MPI_Comm handle_ = MPI_COMM_NULL;
};

/// What workers tell rank 0, and rank 0 all others: small enough for MPI to send it at once, read or not.
struct Notice {
  enum class Kind : std::int32_t {
    call,      ///< to rank 0: has begun a call
    go,        ///< to the others: all have begun it
    count,     ///< to the others: workers that have begun it
    progress,  ///< to rank 0: the work between two calls gets on
    finished,  ///< leaves in peace
    stop       ///< ends the run: text
  };
  Kind kind = Kind::progress;
  std::int32_t rank = 0;
  std::uint64_t sequence = 0, bytes = 0;
  Operation operation = Operation::barrier;
  char text[223] = {};
};
static_assert(std::is_trivially_copyable_v<Notice>);

class MpiExchange : public WorkerExchange {
 public:
  explicit MpiExchange(const RingConfig& config)
      : config_(config), identity_(control_.identity()), exceptions_at_start_(std::uncaught_exceptions()) {
    check_world();
    begun_.resize(is_root() ? static_cast<std::size_t>(identity_.world_size) : 0);
  }
  ~MpiExchange() override {
    if (abandoned_) return;
    if (std::uncaught_exceptions() > exceptions_at_start_) {
      abandon("an error");
      return;
    }
    try {
      tell(Notice::Kind::finished, {});
      flush();
    } catch (const RunError&) {
      library_.is_whole = false;
    }
  }

  [[nodiscard]] WorkerIdentity identity() const override { return identity_; }

  void begin(Operation operation, std::size_t bytes) override {
    if (abandoned_) throw RunError("MPI", *abandoned_);
    if (is_root())
      gather_calls(operation, bytes);
    else
      state_call(operation, bytes);
    ++sequence_;
  }

  void all_to_all(std::span<const std::byte> sent, std::span<const std::size_t> starts, std::span<std::byte> received) override {
    const Parts parts(starts);
    const int count = parts.counts[static_cast<std::size_t>(identity_.rank)];
    const std::size_t world = static_cast<std::size_t>(identity_.world_size);
    std::vector<int> counts(world, count), places(world);
    for (std::size_t p = 0; p < world; ++p) places[p] = as_count(p * static_cast<std::size_t>(count));
    wait("MPI_Ialltoallv", [&](MPI_Request* request) {
      return MPI_Ialltoallv(sent.data(), parts.counts.data(), parts.places.data(), MPI_BYTE, received.data(), counts.data(), places.data(),
                            MPI_BYTE, data_.get(), request);
    });
  }
  void all_gather(std::span<std::byte> buffer, std::span<const std::size_t> starts) override {
    const Parts parts(starts);
    wait("MPI_Iallgatherv", [&](MPI_Request* request) {
      return MPI_Iallgatherv(MPI_IN_PLACE, 0, MPI_DATATYPE_NULL, buffer.data(), parts.counts.data(), parts.places.data(), MPI_BYTE,
                             data_.get(), request);
    });
  }
  void broadcast(std::span<std::byte> buffer) override {
    wait("MPI_Ibcast",
         [&](MPI_Request* request) { return MPI_Ibcast(buffer.data(), as_count(buffer.size()), MPI_BYTE, 0, data_.get(), request); });
  }
  void library_sum(std::span<float> buffer) override {
    check(MPI_Allreduce(MPI_IN_PLACE, buffer.data(), as_count(buffer.size()), MPI_FLOAT, MPI_SUM, data_.get()), "MPI_Allreduce");
  }

  void note_progress() override {
    if (abandoned_ || Clock::now() - signed_at_ < kBetweenSigns) return;
    signed_at_ = Clock::now();
    is_news_ = true;
    if (!is_root()) tell(Notice::Kind::progress, {});
    look();
  }
  int num_waiting() override {
    if (abandoned_) return 0;
    look();
    return is_root() ? num_begun() : counted_.sequence == sequence_ ? static_cast<int>(counted_.bytes) : 0;
  }

  void abandon(const std::string& reason) override {
    if (abandoned_) return;
    abandoned_ = reason;
    library_.is_whole = false;
    try {
      if (!stop_) tell(Notice::Kind::stop, reason);
      flush();
    } catch (const RunError&) {  // the launcher ends the job all the same
    }
  }

 private:
  struct Begun {
    std::optional<Notice> call;  ///< the last one
    bool finished = false;
  };
  struct Parts {
    explicit Parts(std::span<const std::size_t> starts) {
      for (std::size_t p = 0; p + 1 < starts.size(); ++p) {
        places.push_back(as_count(starts[p]));
        counts.push_back(as_count(starts[p + 1] - starts[p]));
      }
    }
    std::vector<int> counts, places;
  };

  static int as_count(std::size_t bytes) {
    if (bytes > static_cast<std::size_t>(std::numeric_limits<int>::max()))
      throw RunError("MPI", fmt::format("{} bytes in one call exceed its limit of 2 GiB", bytes));
    return static_cast<int>(bytes);
  }
  [[nodiscard]] bool is_root() const { return identity_.rank == 0; }

  /// The world is the launcher's, and no link without keys leaves the host unasked.
  void check_world() {
    const auto [rank, world_size] = config_.identity;
    if (identity_.world_size != world_size || identity_.rank != rank) {
      library_.is_whole = false;  // others may have found no fault, and would wait in MPI_Finalize for this one
      throw InputError("network.collective = mpi",
                       fmt::format("MPI says rank {} of {}, the launcher {} of {}", identity_.rank, identity_.world_size, rank, world_size),
                       "start the workers with mpirun, or with srun --mpi=pmix");
    }
    MPI_Comm host = MPI_COMM_NULL;
    int on_host = 0;
    check(MPI_Comm_split_type(control_.get(), MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &host), "MPI_Comm_split_type");
    check(MPI_Comm_size(host, &on_host), "MPI_Comm_size");
    check(MPI_Comm_free(&host), "MPI_Comm_free");
    if (on_host < world_size && !config_.network.insecure)
      throw InputError("network.collective = mpi", "connects several hosts without encryption and keys",
                       "use --insecure-network on a network that you trust, or network.collective=zeromq with keys");
  }

  /// Rank 0: waits for all, compares, lets them go.
  void gather_calls(Operation operation, std::size_t bytes) {
    Deadline deadline(config_.timeout);
    in_call_ = is_news_ = true;
    for (int looks = 0; num_begun() + 1 < identity_.world_size; ++looks) {
      if (look()) deadline.restart(), looks = 0;
      for (int rank = 1; rank < identity_.world_size; ++rank)
        if (begun(rank).finished && !has_begun(rank))
          throw WorldLost(worker_name(rank), fmt::format("has finished after {} collective calls, but this worker makes another call",
                                                         begun(rank).call ? begun(rank).call->sequence + 1 : 0));
      if (deadline.is_over()) throw missed(missing());
      pause(looks);
    }
    in_call_ = false;
    for (int rank = 1; rank < identity_.world_size; ++rank) {
      const Notice& call = *begun(rank).call;
      if (call.operation != operation || call.bytes != bytes)
        throw RunError(worker_name(rank),
                       fmt::format("calls {} with {} bytes, but worker 0 calls {} with {} bytes; start all workers with the same program "
                                   "and config",
                                   name_of(call.operation), call.bytes, name_of(operation), bytes));
    }
    tell(Notice::Kind::go, {});
  }
  void state_call(Operation operation, std::size_t bytes) {
    Notice notice = made(Notice::Kind::call, {});
    notice.operation = operation;
    notice.bytes = bytes;
    send(0, notice);
    Deadline deadline(config_.timeout + 2 * kBetweenSigns);  // rank 0 names who is missing first
    for (int looks = 0; num_granted_ <= sequence_; ++looks) {
      if (look()) deadline.restart(), looks = 0;
      if (root_finished_ && num_granted_ <= sequence_) throw WorldLost(worker_name(0), "has finished, but this worker makes another call");
      if (deadline.is_over()) throw missed({0});
      pause(looks);
    }
  }
  [[nodiscard]] WorldLost missed(const std::vector<int>& ranks) const {
    return {fmt::format("worker {}", listed(ranks, ", ")),
            fmt::format("did not take part in collective call {} within {} ms", sequence_, config_.timeout.count())};
  }

  /// Makes progress on one operation of the library until it is done.
  template <class Start>
  void wait(const char* name, const Start& start) {
    MPI_Request request = MPI_REQUEST_NULL;
    check(start(&request), name);
    const Deadline deadline(config_.timeout);
    for (int looks = 0;; ++looks) {
      int done = 0;
      check(MPI_Test(&request, &done, MPI_STATUS_IGNORE), name);
      if (done) return;
      look();
      if (deadline.is_over()) throw WorldLost("MPI", fmt::format("{} was not complete within {} ms", name, config_.timeout.count()));
      pause(looks);
    }
  }

  struct Deadline {
    explicit Deadline(milliseconds allowed) : timeout(allowed) { restart(); }
    void restart() { at = Clock::now() + timeout; }
    [[nodiscard]] bool is_over() const { return Clock::now() > at; }
    milliseconds timeout;
    Clock::time_point at;
  };
  /// First short, then longer and longer, so that hundreds that wait leave the cores to those that work.
  static void pause(int looks) {
    if (looks < kYields)
      ::sched_yield();
    else
      std::this_thread::sleep_for(std::chrono::microseconds(std::min(20 * (looks - kYields), kLongestSleep_us)));
  }

  [[nodiscard]] Notice made(Notice::Kind kind, const std::string& text) const {
    Notice notice;
    notice.kind = kind;
    notice.rank = identity_.rank;
    notice.sequence = sequence_;
    std::memcpy(notice.text, text.data(), std::min(text.size(), sizeof(notice.text) - 1));
    return notice;
  }
  /// To rank 0, or of rank 0 to all others.
  void tell(Notice::Kind kind, const std::string& text) { tell(made(kind, text)); }
  void tell(const Notice& notice) {
    if (!is_root()) return send(0, notice);
    for (int rank = 1; rank < identity_.world_size; ++rank) send(rank, notice);
  }
  /// Rank 0: to all but its sender.  What has ended the run is said to have, also where a send fails.
  void forward(const Notice& stop, int sender) {
    for (int rank = 1; rank < identity_.world_size; ++rank) try {
        if (rank != sender) send(rank, stop);
      } catch (const RunError&) {
      }
  }
  void send(int rank, const Notice& notice) {
    reap();
    Sent& sent = sent_.emplace_back(Sent{notice, MPI_REQUEST_NULL});
    check(MPI_Isend(&sent.notice, sizeof(Notice), MPI_BYTE, rank, 0, control_.get(), &sent.request), "MPI_Isend");
  }
  void reap() {
    for (int done = 1; !sent_.empty() && done;) {
      check(MPI_Test(&sent_.front().request, &done, MPI_STATUS_IGNORE), "MPI_Test");
      if (done) sent_.pop_front();
    }
  }
  void flush() {
    const Deadline deadline(kGrace);
    for (int looks = 0; !sent_.empty() && !deadline.is_over(); ++looks) reap(), pause(looks);
  }

  /// Takes what has come; rank 0 passes news on.  Whether any worker has got on.  Throws what has ended the run.
  bool look() {
    bool got_on = false;
    while (true) {
      int is_there = 0;
      MPI_Status status;
      check(MPI_Iprobe(MPI_ANY_SOURCE, 0, control_.get(), &is_there, &status), "MPI_Iprobe");
      if (!is_there) break;
      Notice notice;
      check(MPI_Recv(&notice, sizeof(notice), MPI_BYTE, status.MPI_SOURCE, 0, control_.get(), MPI_STATUS_IGNORE), "MPI_Recv");
      take(status.MPI_SOURCE, notice);
      got_on = true;
    }
    is_news_ = is_news_ || got_on;
    if (is_root() && is_news_ && Clock::now() - told_at_ > kBetweenNews) {
      told_at_ = Clock::now();
      is_news_ = false;
      Notice count = made(Notice::Kind::count, {});
      count.bytes = static_cast<std::uint64_t>(num_begun() + (in_call_ ? 1 : 0));
      tell(count);
    }
    if (stop_) throw WorldLost(worker_name(stop_->rank), fmt::format("stopped the run: {}", stop_->text));
    return got_on;
  }
  void take(int from, const Notice& notice) {
    switch (notice.kind) {
      case Notice::Kind::call:
        begun(from).call = notice;
        return;
      case Notice::Kind::go:
        num_granted_ = notice.sequence + 1;
        return;
      case Notice::Kind::count:
        counted_ = notice;
        return;
      case Notice::Kind::progress:
        return;
      case Notice::Kind::finished:
        if (is_root()) begun(from).finished = true;
        root_finished_ = !is_root();
        return;
      case Notice::Kind::stop:
        if (stop_) return;
        stop_ = notice;
        if (is_root()) forward(notice, from);
        return;
    }
  }
  [[nodiscard]] Begun& begun(int rank) { return begun_[static_cast<std::size_t>(rank)]; }
  [[nodiscard]] bool has_begun(int rank) { return begun(rank).call && begun(rank).call->sequence == sequence_; }
  [[nodiscard]] std::vector<int> missing() {
    std::vector<int> ranks;
    for (int rank = 1; rank < identity_.world_size; ++rank)
      if (!has_begun(rank)) ranks.push_back(rank);
    return ranks;
  }
  [[nodiscard]] int num_begun() const {
    return static_cast<int>(std::ranges::count_if(begun_, [&](const Begun& one) { return one.call && one.call->sequence == sequence_; }));
  }

  struct Sent {
    Notice notice;
    MPI_Request request;
  };
  RingConfig config_;
  MpiLibrary library_;
  Communicator control_{library_}, data_{library_};
  WorkerIdentity identity_;
  int exceptions_at_start_;
  std::uint64_t sequence_ = 0, num_granted_ = 0;
  std::deque<Sent> sent_;     ///< MPI reads them until their requests are done
  std::vector<Begun> begun_;  ///< rank 0: by rank
  Notice counted_{};          ///< others: what rank 0 has counted
  bool root_finished_ = false, in_call_ = false, is_news_ = false;
  Clock::time_point told_at_, signed_at_;
  std::optional<Notice> stop_;
  std::optional<std::string> abandoned_;
};

}  // namespace

std::shared_ptr<WorkerExchange> join_mpi(const RingConfig& config) { return std::make_shared<MpiExchange>(config); }
#else
std::shared_ptr<WorkerExchange> join_mpi(const RingConfig&) {
  throw InputError("network.collective = mpi", "MPI is not part of this build", "install libopenmpi-dev and build again");
}
#endif

}  // namespace earshot
