// SPDX-License-Identifier: Apache-2.0
#include "tests/support/simulation/simulated_network.h"

#include <algorithm>
#include <cerrno>
#include <utility>

namespace earshot::simulation {
namespace {

Network* current_network = nullptr;

constexpr Nanos kBeat = 100 * kMilli;            // heartbeats are looked at so often
constexpr Nanos kRetransmission = 200 * kMilli;  // of TCP, over a link that was cut
constexpr Nanos kHandshake = 30 * kSecond;       // libzmq's limit for a connection to come up

}  // namespace

void Content::own() {
  if (lent == nullptr) return;
  bytes.assign(static_cast<const char*>(lent), size);
  lent = nullptr;
  if (give_back != nullptr) give_back(nullptr, hint);
}

Network* Network::current() { return current_network; }

Network::Network(std::uint64_t seed) : random_(seed) {
  current_network = this;
  at(now_ + kBeat, [this] { beat(); });
}

Network::~Network() {
  for (const auto& process : processes_)
    if (process->alive && !process->fiber->has_ended()) kill(*process, true);
  current_network = nullptr;
}

void Network::at(Nanos time, std::function<void()> action) { events_.push({std::max(time, now_), ++num_events_, std::move(action)}); }

void Network::run(Nanos until, const std::function<bool()>& is_done) {
  while (!events_.empty() && events_.top().time <= until && !is_done()) {
    now_ = events_.top().time;
    const std::function<void()> action = std::move(const_cast<Event&>(events_.top()).action);
    events_.pop();
    action();
  }
}

Process& Network::start(int rank, int slowness, std::function<void()> body) {
  Process& process = *processes_.emplace_back(std::make_unique<Process>());
  process.rank = rank;
  process.slowness = slowness;
  process.fiber = std::make_unique<Fiber>(std::move(body));
  process.waits = process.wake_is_due = true;
  at(now_, [this, &process, turn = process.turn] { resume(process, turn); });
  return process;
}

void Network::resume(Process& process, std::uint64_t turn) {
  if (process.turn != turn || process.fiber->has_ended()) return;
  const Nanos free_at = std::max(process.stopped_until, process.stuck_until);
  if (now_ < free_at) return at(free_at, [this, &process, turn] { resume(process, turn); });
  if (!process.alive) return;
  ++process.turn;
  process.waits = process.wake_is_due = false;
  process.has_begun = true;
  running_ = &process;
  process.fiber->resume();
  running_ = nullptr;
  if (!process.fiber->has_ended() || !process.alive) return;
  const auto sockets = process.sockets;
  for (Socket* socket : sockets) close(socket);
}

void Network::wait(Nanos deadline, bool quietly) {
  Process& process = *running_;
  if (process.alive) {
    process.waits = true;
    if (deadline < INT64_MAX) at(deadline, [this, &process, turn = process.turn] { resume(process, turn); });
    process.fiber->pause();
  }
  if (!process.alive && !quietly) throw ProcessKilled{};
}

void Network::notify(Process& process) {
  if (!process.waits || process.wake_is_due) return;
  process.wake_is_due = true;
  at(now_ + process.slowness * random_.between(1 * kMicro, 30 * kMicro), [this, &process, turn = process.turn] { resume(process, turn); });
}

void Network::kill(Process& process, bool dark) {
  if (!process.alive) return;
  process.alive = false;
  process.dark = dark;
  if (process.on_death) process.on_death();
  const auto sockets = process.sockets;
  for (Socket* socket : sockets) {
    if (dark && socket->is_bound) dark_endpoints_[socket->endpoint] = &process;
    const auto links = std::exchange(socket->links, {});
    for (const Link& link : links) {
      const int side = link->sockets[0] == socket ? 0 : 1;
      if (random_.chance(0.3)) link->flows[side].wire.clear();  // a reset
      close_end(link, side, 0);
    }
    if (socket->is_bound) listeners_.erase(socket->endpoint);
  }
  if (running_ == &process) return;  // it dies where it waits next
  Process* const before = std::exchange(running_, &process);
  ++process.turn;
  process.waits = false;
  if (process.has_begun && !process.fiber->has_ended()) process.fiber->resume();
  running_ = before;
}

void Network::stop(Process& process, Nanos duration) {
  if (!process.alive) return;
  process.stopped_until = now_ + duration;
  at(process.stopped_until, [this, &process, duration] {
    if (!process.alive || now_ < process.stopped_until) return;
    // libzmq's timers may come before what has arrived meanwhile.
    const auto sockets = process.sockets;
    for (Socket* socket : sockets)
      for (const Link& link : std::vector<Link>(socket->links))
        if (link->sockets[0] == socket && socket->heartbeat_ms > 0 && link->is_up && duration > socket->heartbeat_timeout_ms * kMilli &&
            random_.chance(0.5))
          end(link, 0);
  });
}

bool Network::is_cut(const Process& from, const Process& to) const {
  const auto found = cut_until_.find({from.rank, to.rank});
  return found != cut_until_.end() && now_ < found->second;
}

Nanos Network::held_up(const Link& link) {
  Nanos delay = 0;
  for (const Process* const process : link->processes) {
    if (process == nullptr) continue;
    const auto found = hold_ups_.find(process->rank);
    if (found != hold_ups_.end() && now_ < found->second.until && random_.chance(found->second.share)) delay += found->second.delay;
  }
  return delay;
}

void Network::cut(int from, int to, Nanos duration) {
  Nanos& until = cut_until_[{from, to}];
  until = std::max(until, now_ + duration);
}

void Network::reset(int a, int b) {
  std::vector<Link> between;
  for (const Link& link : all_links_)
    if (link->is_up && !link->has_ended[0] && !link->has_ended[1] &&
        ((link->processes[0]->rank == a && link->processes[1]->rank == b) ||
         (link->processes[0]->rank == b && link->processes[1]->rank == a)))
      between.push_back(link);
  if (between.empty()) return;
  const Link link = between[static_cast<std::size_t>(random_.between(0, static_cast<std::int64_t>(between.size()) - 1))];
  link->is_broken = true;
  for (Flow& flow : link->flows) flow.wire.clear();
  for (const int side : {0, 1}) at(now_ + latency(), [this, link, side] { end(link, side); });
}

Socket* Network::open(Context* context, int type) {
  auto* socket = new Socket;
  socket->type = type;
  socket->context = context;
  socket->process = context->process;
  if (socket->process != nullptr) socket->process->sockets.push_back(socket);
  return socket;
}

void Network::close(Socket* socket) {
  if (socket->closed) return;
  socket->closed = true;
  const auto links = std::exchange(socket->links, {});
  for (const Link& link : links) close_end(link, link->sockets[0] == socket ? 0 : 1, socket->linger_ms);
  if (socket->is_bound) {
    const auto found = listeners_.find(socket->endpoint);
    if (found != listeners_.end() && found->second == socket) listeners_.erase(found);
  }
  if (socket->process != nullptr) {
    std::erase(socket->process->sockets, socket);
    for (Socket* other : socket->process->sockets)
      if (other->monitor == socket) other->monitor = nullptr;
  }
  delete socket;
}

int Network::bind(Socket* socket, const std::string& endpoint) {
  std::string place = endpoint;
  if (place.ends_with(":*")) place = place.substr(0, place.size() - 1) + std::to_string(next_port_++);
  if (listeners_.contains(place)) return EADDRINUSE;
  if (!socket->process->alive) return EADDRNOTAVAIL;
  dark_endpoints_.erase(place);
  listeners_[place] = socket;
  socket->endpoint = place;
  socket->is_bound = true;
  return 0;
}

void Network::connect(Socket* socket, const std::string& endpoint) {
  socket->endpoint = endpoint;
  auto link = std::make_shared<Connection>();
  link->sockets[0] = socket;
  link->processes[0] = socket->process;
  link->endpoint = endpoint;
  link->routing_id = socket->routing_id;
  if (link->routing_id.empty()) link->routing_id = "#" + std::to_string(random_.next());
  link->capacity = static_cast<std::size_t>(random_.between(1, 8));
  socket->links = {link};
  all_links_.push_back(link);
  if (all_links_.size() > 64) std::erase_if(all_links_, [](const Link& old) { return old.use_count() == 1; });
  at(now_ + latency(), [this, link, since = now_] { dial(link, since); });
}

void Network::dial(const Link& link, Nanos since) {
  Process& process = *link->processes[0];
  if (!process.alive || link->has_ended[0]) return;
  if (link->is_closing[0] && link->flows[0].pipe.empty()) return;
  const auto again = [&](Nanos delay) { at(now_ + delay, [this, link, since] { dial(link, since); }); };
  if (now_ < process.stopped_until) return again(process.stopped_until - now_);
  Socket* const socket = link->sockets[0];
  if (socket == nullptr && !link->is_closing[0]) return;
  if (now_ - since > kHandshake) return end(link, 0);
  const auto found = listeners_.find(link->endpoint);
  if (found == listeners_.end()) {
    if (dark_endpoints_.contains(link->endpoint)) return again(kSecond);
    tell(socket, ZMQ_EVENT_CLOSED);
    if (socket != nullptr && socket->reconnect_ms > 0) {
      since = now_;
      return again(random_.between(socket->reconnect_ms, 5 * socket->reconnect_ms) * kMilli);
    }
    return end(link, 0);
  }
  Process& other = *found->second->process;
  if (is_cut(process, other) || is_cut(other, process)) return again(kRetransmission);
  if (now_ < other.stopped_until) return again(20 * kMilli);
  establish(link, found->second);
}

void Network::establish(const Link& link, Socket* listener) {
  link->sockets[1] = listener;
  link->processes[1] = listener->process;
  link->is_up = true;
  link->heard_at = now_;
  for (const Link& other : listener->links)
    if (other->routing_id == link->routing_id && (!other->has_ended[1] || !other->flows[0].received.empty())) link->is_anonymous = true;
  listener->links.push_back(link);
  notify(*link->processes[0]);
  pump(link, 0);
}

bool Network::can_send(const Socket& socket) const {
  if (socket.links.empty()) return false;
  const Connection& link = *socket.links.front();
  if (link.has_ended[0] || (!link.is_up && socket.immediate)) return false;
  return link.flows[0].pipe.size() < static_cast<std::size_t>(socket.sndhwm);
}

void Network::count_message(Process& process) {
  ++num_messages_;
  if (process.dies_after_messages >= 0 && process.dies_after_messages-- == 0) kill(process, random_.chance(0.1));
}

bool Network::send(Socket& socket, Message message) {
  if (!socket.process->alive || !can_send(socket)) return false;
  const Link link = socket.links.front();
  if (on_send) on_send(*socket.process, message);
  link->flows[0].pipe.push_back(std::move(message));
  pump(link, 0);
  count_message(*socket.process);
  return true;
}

bool Network::send_to(Socket& socket, Message message, int& error) {
  const std::string name(static_cast<const char*>(message.front()->data()), message.front()->length());
  error = EHOSTUNREACH;
  if (!socket.process->alive) return false;
  for (const Link& link : socket.links) {
    if (link->routing_id != name || link->has_ended[1] || link->is_anonymous) continue;
    error = EAGAIN;
    if (link->flows[1].pipe.size() >= static_cast<std::size_t>(socket.sndhwm)) return false;
    message.erase(message.begin());
    link->flows[1].pipe.push_back(std::move(message));
    pump(link, 1);
    count_message(*socket.process);
    return true;
  }
  return false;
}

/// From the sender's queue onto the way.
void Network::pump(const Link& link, int from) {
  Flow& flow = link->flows[from];
  if (!link->is_up || link->is_broken || link->has_ended[from]) return;
  while (!flow.pipe.empty() && flow.wire.size() < link->capacity) {
    Message message = std::move(flow.pipe.front());
    flow.pipe.pop_front();
    for (const auto& part : message) part->own();
    const Nanos last = flow.wire.empty() ? now_ : flow.wire.back().arrives;
    flow.wire.push_back({std::move(message), std::max(last, now_ + latency() + held_up(link)), false});
    notify(*link->processes[from]);
  }
  if (flow.pipe.empty() && link->is_closing[from]) put_end(link, from);
  if (flow.is_delivering || flow.is_stalled || flow.wire.empty()) return;
  flow.is_delivering = true;
  at(flow.wire.front().arrives, [this, link, from] { deliver(link, from); });
}

void Network::deliver(const Link& link, int from) {
  Flow& flow = link->flows[from];
  flow.is_delivering = false;
  const int to = 1 - from;
  if (flow.wire.empty()) return;
  Process &sender = *link->processes[from], &receiver = *link->processes[to];
  const auto again = [&](Nanos time) {
    flow.is_delivering = true;
    at(time, [this, link, from] { deliver(link, from); });
  };
  if (link->has_ended[to] || link->is_broken || !receiver.alive) {
    flow.wire.clear();
    return;
  }
  if (is_cut(sender, receiver)) return again(now_ + random_.between(kRetransmission / 4, kRetransmission));
  if (now_ < receiver.stopped_until) return again(receiver.stopped_until + random_.between(0, kMilli));
  if (flow.wire.front().is_end) {
    flow.wire.clear();
    return end(link, to);
  }
  Socket* const socket = link->sockets[to];
  if (socket != nullptr && flow.received.size() >= static_cast<std::size_t>(socket->rcvhwm)) {
    flow.is_stalled = true;
    return;
  }
  link->heard_at = now_;
  if (socket != nullptr) flow.received.push_back(std::move(flow.wire.front().message));
  flow.wire.pop_front();
  if (socket != nullptr) notify(receiver);
  pump(link, from);
}

void Network::put_end(const Link& link, int from) {
  link->is_closing[from] = false;
  const bool dark = link->processes[from]->dark;
  if (!link->has_ended[from]) {
    link->has_ended[from] = true;
    Flow& flow = link->flows[from];
    if (!dark && link->is_up && link->processes[1 - from] != nullptr) {
      flow.wire.push_back({{}, std::max(flow.wire.empty() ? now_ : flow.wire.back().arrives, now_ + latency()), true});
      if (!flow.is_delivering && !flow.is_stalled) {
        flow.is_delivering = true;
        at(flow.wire.front().arrives, [this, link, from] { deliver(link, from); });
      }
    }
  }
}

/// That end sees that the connection has ended.
void Network::end(const Link& link, int side) {
  if (link->has_ended[side]) return;
  link->has_ended[side] = true;
  link->is_closing[side] = false;
  auto queued = std::exchange(link->flows[side].pipe, {});
  Socket* const socket = link->sockets[side];
  if (link->is_up && !link->has_ended[1 - side]) {
    Flow& flow = link->flows[side];
    flow.wire.push_back({{}, std::max(flow.wire.empty() ? now_ : flow.wire.back().arrives, now_ + latency()), true});
    if (!flow.is_delivering && !flow.is_stalled) {
      flow.is_delivering = true;
      at(flow.wire.back().arrives, [this, link, side] { deliver(link, side); });
    }
  }
  if (link->processes[side] != nullptr) notify(*link->processes[side]);
  if (socket == nullptr) return;
  if (side == 1) {
    if (link->flows[0].received.empty()) std::erase(socket->links, link);
    return;
  }
  tell(socket, link->is_up ? ZMQ_EVENT_DISCONNECTED : ZMQ_EVENT_CLOSED);
  if (socket->reconnect_ms <= 0) return;
  // Another connection of the same socket; what was read before stays readable.
  auto received = std::move(link->flows[1].received);
  connect(socket, socket->endpoint);
  socket->links.front()->flows[1].received = std::move(received);
  if (!socket->immediate) socket->links.front()->flows[0].pipe = std::move(queued);
}

/// The socket at that end closes.
void Network::close_end(const Link& link, int side, int linger_ms) {
  Socket* const socket = std::exchange(link->sockets[side], nullptr);
  link->flows[1 - side].received.clear();
  if (link->has_ended[side]) {
    link->flows[side].pipe.clear();
    return;
  }
  Flow& flow = link->flows[side];
  if (linger_ms == 0 || flow.pipe.empty() || (side == 0 && !link->is_up && socket->immediate)) {
    flow.pipe.clear();
    return put_end(link, side);
  }
  link->is_closing[side] = true;
  Context* const context = socket->context;
  ++context->num_closing;
  Process* const process = socket->process;
  // Looks now and then: its end is what zmq_ctx_term() waits for.
  const Nanos limit = linger_ms < 0 ? INT64_MAX : now_ + linger_ms * kMilli;
  struct Watch {
    static void look(Network& network, const Link& link, int side, Nanos limit, Context* context, Process* process) {
      if (link->is_closing[side] && network.now() < limit && process->alive) {
        network.at(network.now() + 2 * kMilli,
                   [&network, link, side, limit, context, process] { look(network, link, side, limit, context, process); });
        return;
      }
      if (link->is_closing[side]) {
        link->flows[side].pipe.clear();
        network.put_end(link, side);
      }
      if (!process->alive) return;
      --context->num_closing;
      network.notify(*process);
    }
  };
  Watch::look(*this, link, side, limit, context, process);
}

void Network::tell(Socket* socket, std::uint16_t event) {
  if (socket == nullptr || socket->monitor == nullptr || (socket->monitor_events & event) == 0) return;
  socket->monitor->events.push_back(event);
  notify(*socket->process);
}

bool Network::is_readable(const Socket& socket) const {
  if (!socket.receiving.empty() || !socket.events.empty()) return true;
  const int from = socket.type == ZMQ_ROUTER ? 0 : 1;
  return std::ranges::any_of(socket.links, [&](const Link& link) { return !link->is_anonymous && !link->flows[from].received.empty(); });
}

Link Network::next_readable(Socket& socket) {
  const int from = socket.type == ZMQ_ROUTER ? 0 : 1;
  const auto count = static_cast<std::int64_t>(socket.links.size());
  if (count == 0) return nullptr;
  const std::int64_t first = count > 1 ? random_.between(0, count - 1) : 0;
  for (std::int64_t i = 0; i < count; ++i) {
    const Link& link = socket.links[static_cast<std::size_t>((first + i) % count)];
    if (!link->is_anonymous && !link->flows[from].received.empty()) return link;
  }
  return nullptr;
}

void Network::after_read(const Link& link) {
  for (const int from : {0, 1}) {
    Flow& flow = link->flows[from];
    if (std::exchange(flow.is_stalled, false)) {
      flow.is_delivering = true;
      at(now_, [this, link, from] { deliver(link, from); });
    }
  }
  if (link->has_ended[1] && link->sockets[1] != nullptr && link->flows[0].received.empty()) std::erase(link->sockets[1]->links, link);
}

/// Heartbeats of all connections that have them: an answer needs the other's I/O thread and both ways.
void Network::beat() {
  at(now_ + kBeat, [this] { beat(); });
  for (const Link& link : std::vector<Link>(all_links_)) {
    Socket* const socket = link->sockets[0];
    if (socket == nullptr || socket->heartbeat_ms == 0 || !link->is_up || link->has_ended[0] || now_ < socket->process->stopped_until)
      continue;
    const Process& other = *link->processes[1];
    const bool answers = other.alive && now_ >= other.stopped_until && !is_cut(*socket->process, other) && !is_cut(other, *socket->process);
    if (answers) link->heard_at = now_;
    if (now_ - link->heard_at > (socket->heartbeat_ms + socket->heartbeat_timeout_ms) * kMilli) end(link, 0);
  }
}

}  // namespace earshot::simulation
