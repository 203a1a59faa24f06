// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <zmq.h>

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <queue>
#include <string>
#include <vector>

#include "tests/support/simulation/fiber.h"

namespace earshot::simulation {

using Nanos = std::int64_t;
inline constexpr Nanos kMicro = 1000, kMilli = 1000 * kMicro, kSecond = 1000 * kMilli;

/// Thrown where a simulated process waits and has been killed.  No std::exception: only its own end catches it.
struct ProcessKilled {};

/// Numbers of one seed (SplitMix64).
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  std::uint64_t next() {
    std::uint64_t z = (state_ += 0x9e3779b97f4a7c15);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
    z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
    return z ^ (z >> 31);
  }
  /// In [first, last].
  std::int64_t between(std::int64_t first, std::int64_t last) {
    return first + static_cast<std::int64_t>(next() % static_cast<std::uint64_t>(last - first + 1));
  }
  bool chance(double p) { return static_cast<double>(next() >> 11) * 0x1p-53 < p; }

 private:
  std::uint64_t state_;
};

/// The bytes of one part of a message: owned, or lent by the sender until they have left.
struct Content {
  std::string bytes;
  void* lent = nullptr;
  std::size_t size = 0;
  zmq_free_fn* give_back = nullptr;
  void* hint = nullptr;
  Content() = default;
  Content(const Content&) = delete;
  Content& operator=(const Content&) = delete;
  ~Content() { own(); }
  /// What the sender holds in its memory at this moment.
  void own();
  [[nodiscard]] void* data() { return lent != nullptr ? lent : bytes.data(); }
  [[nodiscard]] std::size_t length() const { return lent != nullptr ? size : bytes.size(); }
};
using Message = std::vector<std::unique_ptr<Content>>;

struct Socket;
class Network;

/// One process of a run: a fiber, and an I/O thread that goes on while the fiber waits or hangs.
struct Process {
  int rank = 0;
  std::unique_ptr<Fiber> fiber;
  bool alive = true, dark = false;                             ///< dark: its machine has gone, and no end of a connection is told
  bool has_begun = false, waits = false, wake_is_due = false;  ///< of the fiber
  std::uint64_t turn = 0;
  Nanos stopped_until = 0, stuck_until = 0;  ///< whole process; fiber alone
  int slowness = 1;
  std::vector<Socket*> sockets;
  std::int64_t dies_after_messages = -1;  ///< that it sends
  std::function<void()> on_death;
};

/// One direction of a connection: the sender's queue, what is on its way, and the receiver's queue.
struct Flow {
  std::deque<Message> pipe, received;
  struct InTransit {
    Message message;
    Nanos arrives = 0;
    bool is_end = false;  ///< of the connection
  };
  std::deque<InTransit> wire;
  bool is_delivering = false, is_stalled = false;
};

/// Ends: 0 dials, 1 listens.
struct Connection {
  Socket* sockets[2] = {nullptr, nullptr};
  Process* processes[2] = {nullptr, nullptr};
  Flow flows[2];                          ///< by sender
  bool is_up = false, is_broken = false;  ///< broken: reset, and nothing arrives any more
  bool has_ended[2] = {false, false};     ///< as that end knows
  bool is_closing[2] = {false, false};    ///< its socket has closed, and what it has queued may still leave
  bool is_anonymous = false;              ///< the listener has another one of that name
  std::string routing_id, endpoint;
  Nanos heard_at = 0;        ///< of heartbeats
  std::size_t capacity = 4;  ///< messages on their way
};
using Link = std::shared_ptr<Connection>;

struct Context {
  Process* process = nullptr;
  int num_closing = 0;
};

struct Socket {
  int type = 0;
  Context* context = nullptr;
  Process* process = nullptr;
  std::string routing_id, endpoint;
  bool is_bound = false, immediate = false, mandatory = false, closed = false;
  int linger_ms = -1, sndhwm = 1000, rcvhwm = 1000, reconnect_ms = 100, heartbeat_ms = 0, heartbeat_timeout_ms = 0;
  std::vector<Link> links;  ///< of a dialer one at most
  Message sending;          ///< parts of a message that is not whole yet
  std::deque<std::unique_ptr<Content>> receiving;
  std::deque<std::uint16_t> events;  ///< of a monitor
  std::string monitor_address;
  int monitor_events = 0;
  Socket* monitor = nullptr;  ///< reader of what befalls this one
};

/// Machines, processes, connections and the clock of one simulated run: one thread, and all that is left to chance comes from the seed.
///
/// Messages of one connection keep their order, those of different ones do not.  Cut links hold what is on its way, as TCP does.
class Network {
 public:
  explicit Network(std::uint64_t seed);
  ~Network();
  Network(const Network&) = delete;
  Network& operator=(const Network&) = delete;

  /// The one that libzmq's functions and the clock of this thread belong to; null outside a run.
  static Network* current();

  [[nodiscard]] Nanos now() const { return now_; }
  [[nodiscard]] Random& random() { return random_; }
  void at(Nanos time, std::function<void()> action);
  /// Runs until the time has come or all is done.
  void run(Nanos until, const std::function<bool()>& is_done);
  [[nodiscard]] std::uint64_t num_messages() const { return num_messages_; }
  /// Sees each message that a dialer sends.
  std::function<void(const Process&, const Message&)> on_send;

  Process& start(int rank, int slowness, std::function<void()> body);
  /// The one whose code runs.
  [[nodiscard]] Process* running() const { return running_; }
  /// Of the running process: waits for something that befalls it, until the deadline at most.  Throws ProcessKilled, unless `quietly`.
  void wait(Nanos deadline, bool quietly = false);
  void notify(Process& process);

  void kill(Process& process, bool dark);
  /// As SIGSTOP and SIGCONT.
  void stop(Process& process, Nanos duration);
  /// An endless loop: its I/O thread goes on.
  void hang(Process& process, Nanos duration) { process.stuck_until = now_ + duration; }
  /// Cuts the way from one rank to another.
  void cut(int from, int to, Nanos duration);
  /// Messages from and to a rank take so much longer, each of them with this probability.
  void hold_up(int rank, Nanos delay, double share, Nanos duration) { hold_ups_[rank] = {delay, share, now_ + duration}; }
  /// A reset of one connection between two ranks.
  void reset(int a, int b);
  void set_latency(Nanos least, Nanos most) { least_latency_ = least, most_latency_ = most; }

  // For libzmq's functions.
  Socket* open(Context* context, int type);
  void close(Socket* socket);
  int bind(Socket* socket, const std::string& endpoint);
  void connect(Socket* socket, const std::string& endpoint);
  bool can_send(const Socket& socket) const;
  bool send(Socket& socket, Message message);
  bool send_to(Socket& socket, Message message, int& error);
  Link next_readable(Socket& socket);
  [[nodiscard]] bool is_readable(const Socket& socket) const;
  void after_read(const Link& link);

 private:
  struct Event {
    Nanos time;
    std::uint64_t number;
    std::function<void()> action;
    bool operator<(const Event& other) const { return time != other.time ? time > other.time : number > other.number; }
  };
  [[nodiscard]] Nanos latency() {
    return random_.chance(0.02) ? random_.between(least_latency_, 20 * most_latency_) : random_.between(least_latency_, most_latency_);
  }
  [[nodiscard]] Nanos held_up(const Link& link);
  [[nodiscard]] bool is_cut(const Process& from, const Process& to) const;
  void resume(Process& process, std::uint64_t turn);
  void count_message(Process& process);
  void dial(const Link& link, Nanos since);
  void establish(const Link& link, Socket* listener);
  void pump(const Link& link, int from);
  void deliver(const Link& link, int from);
  void put_end(const Link& link, int from);
  void end(const Link& link, int side);
  void close_end(const Link& link, int side, int linger_ms);
  void tell(Socket* socket, std::uint16_t event);
  void beat();

  Random random_;
  Nanos now_ = 1000 * kSecond;
  std::uint64_t num_events_ = 0, num_messages_ = 0;
  std::priority_queue<Event> events_;
  std::vector<std::unique_ptr<Process>> processes_;
  std::vector<Link> all_links_;
  std::map<std::string, Socket*> listeners_;
  std::map<std::string, Process*> dark_endpoints_;
  std::map<std::pair<int, int>, Nanos> cut_until_;
  struct HoldUp {
    Nanos delay;
    double share;
    Nanos until;
  };
  std::map<int, HoldUp> hold_ups_;  ///< by rank
  Process* running_ = nullptr;
  int next_port_ = 40000;
  Nanos least_latency_ = 20 * kMicro, most_latency_ = 500 * kMicro;
};

}  // namespace earshot::simulation
