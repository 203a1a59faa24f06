// SPDX-License-Identifier: Apache-2.0
// The functions of libzmq that the workers call, the clock and the chance of the system, by the simulated network.  The executable's
// definitions come before those of the libraries, so that what is tried is the product's own code, unchanged.
#include <pthread.h>
#include <sys/random.h>
#include <time.h>
#include <zmq.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <new>
#include <utility>

#include "tests/support/simulation/simulated_network.h"

using namespace earshot::simulation;  // NOLINT(google-build-using-namespace)

namespace {

/// Within zmq_msg_t.
struct Part {
  Content* content;
  bool more;
};
static_assert(sizeof(Part) <= sizeof(zmq_msg_t));
Part& part_of(zmq_msg_t* message) { return *reinterpret_cast<Part*>(message); }
Part& part_of(const zmq_msg_t* message) { return *reinterpret_cast<Part*>(const_cast<zmq_msg_t*>(message)); }

Network& network() { return *Network::current(); }

int fail(int error) {
  errno = error;
  return -1;
}

int send_part(Socket& socket, std::unique_ptr<Content> part, int flags) {
  Network& net = network();
  if (socket.sending.empty() && socket.type == ZMQ_DEALER) {
    while (!net.can_send(socket)) {
      if ((flags & ZMQ_DONTWAIT) != 0 || !socket.process->alive) return fail(EAGAIN);
      net.wait(INT64_MAX);
    }
  }
  const auto size = static_cast<int>(part->length());
  socket.sending.push_back(std::move(part));
  if ((flags & ZMQ_SNDMORE) != 0) {
    if (socket.type != ZMQ_ROUTER) return size;
    // The first part decides whether there is a receiver.
    int error = 0;
    const std::string name(static_cast<const char*>(socket.sending[0]->data()), socket.sending[0]->length());
    const bool known = std::ranges::any_of(
        socket.links, [&](const Link& link) { return link->routing_id == name && !link->has_ended[1] && !link->is_anonymous; });
    if (!known) error = EHOSTUNREACH;
    if (error == 0) return size;
    socket.sending.clear();
    return fail(error);
  }
  Message message = std::move(socket.sending);
  socket.sending.clear();
  if (socket.type == ZMQ_DEALER) return net.send(socket, std::move(message)) ? size : fail(EAGAIN);
  int error = 0;
  return net.send_to(socket, std::move(message), error) ? size : fail(error);
}

std::unique_ptr<Content> text(const std::string& bytes) {
  auto content = std::make_unique<Content>();
  content->bytes = bytes;
  return content;
}

/// Fills socket.receiving with the parts of the next message, if there is one.
void take_message(Socket& socket) {
  if (!socket.events.empty()) {
    std::string event(6, '\0');
    std::memcpy(event.data(), &socket.events.front(), 2);
    socket.events.pop_front();
    socket.receiving.push_back(text(event));
    socket.receiving.push_back(text(""));
    return;
  }
  const Link link = network().next_readable(socket);
  if (!link) return;
  auto& queue = link->flows[socket.type == ZMQ_ROUTER ? 0 : 1].received;
  if (socket.type == ZMQ_ROUTER) socket.receiving.push_back(text(link->routing_id));
  for (auto& part : queue.front()) socket.receiving.push_back(std::move(part));
  queue.pop_front();
  network().after_read(link);
}

}  // namespace

extern "C" {

int zmq_errno() { return errno; }
const char* zmq_strerror(int error) { return std::strerror(error); }
int zmq_has(const char*) { return 0; }

void* zmq_ctx_new() {
  auto* context = new Context;
  context->process = network().running();
  return context;
}
int zmq_ctx_set(void*, int, int) { return 0; }
int zmq_ctx_term(void* context_pointer) {
  auto* context = static_cast<Context*>(context_pointer);
  while (context->num_closing > 0 && context->process->alive) network().wait(INT64_MAX, true);
  if (context->num_closing == 0) delete context;
  return 0;
}

void* zmq_socket(void* context, int type) { return network().open(static_cast<Context*>(context), type); }
int zmq_close(void* socket) {
  network().close(static_cast<Socket*>(socket));
  return 0;
}

int zmq_setsockopt(void* pointer, int option, const void* value, size_t size) {
  auto& socket = *static_cast<Socket*>(pointer);
  int number = 0;
  if (size == sizeof(int)) std::memcpy(&number, value, sizeof(int));
  switch (option) {
    case ZMQ_ROUTING_ID:
      socket.routing_id.assign(static_cast<const char*>(value), size);
      break;
    case ZMQ_LINGER:
      socket.linger_ms = number;
      break;
    case ZMQ_SNDHWM:
      socket.sndhwm = number;
      break;
    case ZMQ_RCVHWM:
      socket.rcvhwm = number;
      break;
    case ZMQ_IMMEDIATE:
      socket.immediate = number != 0;
      break;
    case ZMQ_RECONNECT_IVL:
      socket.reconnect_ms = number;
      break;
    case ZMQ_HEARTBEAT_IVL:
      socket.heartbeat_ms = number;
      break;
    case ZMQ_HEARTBEAT_TIMEOUT:
      socket.heartbeat_timeout_ms = number;
      break;
    case ZMQ_ROUTER_MANDATORY:
      socket.mandatory = number != 0;
      break;
    default:
      break;
  }
  return 0;
}

int zmq_getsockopt(void* pointer, int option, void* value, size_t* size) {
  auto& socket = *static_cast<Socket*>(pointer);
  if (option == ZMQ_LAST_ENDPOINT) {
    if (*size < socket.endpoint.size() + 1) return fail(EINVAL);
    std::memcpy(value, socket.endpoint.c_str(), socket.endpoint.size() + 1);
    *size = socket.endpoint.size() + 1;
    return 0;
  }
  if (option != ZMQ_EVENTS) return fail(EINVAL);
  const int events = (network().is_readable(socket) ? ZMQ_POLLIN : 0) | (network().can_send(socket) ? ZMQ_POLLOUT : 0);
  std::memcpy(value, &events, sizeof(events));
  return 0;
}

int zmq_bind(void* socket, const char* endpoint) {
  const int error = network().bind(static_cast<Socket*>(socket), endpoint);
  return error == 0 ? 0 : fail(error);
}

int zmq_connect(void* pointer, const char* endpoint) {
  auto& socket = *static_cast<Socket*>(pointer);
  if (socket.type != ZMQ_PAIR) {
    network().connect(&socket, endpoint);
    return 0;
  }
  for (Socket* other : socket.process->sockets)
    if (other->monitor_address == endpoint && other->context == socket.context) other->monitor = &socket;
  return 0;
}

int zmq_socket_monitor(void* pointer, const char* address, int events) {
  auto& socket = *static_cast<Socket*>(pointer);
  socket.monitor_address = address == nullptr ? "" : address;
  socket.monitor_events = events;
  if (address == nullptr) socket.monitor = nullptr;
  return 0;
}

int zmq_msg_init(zmq_msg_t* message) {
  new (message) Part{new Content, false};
  return 0;
}
int zmq_msg_init_size(zmq_msg_t* message, size_t size) {
  zmq_msg_init(message);
  part_of(message).content->bytes.resize(size);
  return 0;
}
int zmq_msg_init_data(zmq_msg_t* message, void* data, size_t size, zmq_free_fn* give_back, void* hint) {
  zmq_msg_init(message);
  Content& content = *part_of(message).content;
  content.lent = data;
  content.size = size;
  content.give_back = give_back;
  content.hint = hint;
  if (size == 0) content.own();
  return 0;
}
int zmq_msg_close(zmq_msg_t* message) {
  delete part_of(message).content;
  part_of(message).content = nullptr;
  return 0;
}
int zmq_msg_move(zmq_msg_t* to, zmq_msg_t* from) {
  std::swap(part_of(to), part_of(from));
  delete part_of(from).content;
  part_of(from) = {new Content, false};
  return 0;
}
void* zmq_msg_data(zmq_msg_t* message) { return part_of(message).content->data(); }
size_t zmq_msg_size(const zmq_msg_t* message) { return part_of(message).content->length(); }
int zmq_msg_more(const zmq_msg_t* message) { return part_of(message).more ? 1 : 0; }
const char* zmq_msg_gets(const zmq_msg_t*, const char*) { return nullptr; }

int zmq_msg_send(zmq_msg_t* message, void* socket, int flags) {
  Part& part = part_of(message);
  std::unique_ptr<Content> content(std::exchange(part.content, new Content));
  // A message that does not leave stays with its owner.
  auto& to = *static_cast<Socket*>(socket);
  if (to.type == ZMQ_DEALER && to.sending.empty() && (flags & ZMQ_DONTWAIT) != 0 && !network().can_send(to)) {
    delete std::exchange(part.content, content.release());
    return fail(EAGAIN);
  }
  return send_part(to, std::move(content), flags);
}

int zmq_send(void* socket, const void* data, size_t size, int flags) {
  return send_part(*static_cast<Socket*>(socket), text(std::string(static_cast<const char*>(data), size)), flags);
}

int zmq_msg_recv(zmq_msg_t* message, void* pointer, int flags) {
  auto& socket = *static_cast<Socket*>(pointer);
  while (socket.receiving.empty()) {
    take_message(socket);
    if (!socket.receiving.empty()) break;
    if ((flags & ZMQ_DONTWAIT) != 0) return fail(EAGAIN);
    network().wait(INT64_MAX);
  }
  Part& part = part_of(message);
  delete std::exchange(part.content, socket.receiving.front().release());
  socket.receiving.pop_front();
  part.more = !socket.receiving.empty();
  return static_cast<int>(part.content->length());
}

int zmq_poll(zmq_pollitem_t* items, int count, long timeout_ms) {
  Network& net = network();
  const Nanos deadline = timeout_ms < 0 ? INT64_MAX : net.now() + timeout_ms * kMilli;
  while (true) {
    int ready = 0;
    for (int i = 0; i < count; ++i) {
      auto& socket = *static_cast<Socket*>(items[i].socket);
      items[i].revents = 0;
      if ((items[i].events & ZMQ_POLLIN) != 0 && net.is_readable(socket)) items[i].revents |= ZMQ_POLLIN;
      if ((items[i].events & ZMQ_POLLOUT) != 0 && net.can_send(socket)) items[i].revents |= ZMQ_POLLOUT;
      ready += items[i].revents != 0 ? 1 : 0;
    }
    if (ready > 0 || net.now() >= deadline) return ready;
    net.wait(deadline, true);
    if (!net.running()->alive) return fail(ETERM);  // destructors wait, too, and may not throw
  }
}

ssize_t getrandom(void* buffer, size_t size, unsigned int) {
  auto* bytes = static_cast<char*>(buffer);
  for (size_t i = 0; i < size; ++i)
    bytes[i] = Network::current() == nullptr ? static_cast<char>(i) : static_cast<char>(network().random().next());
  return static_cast<ssize_t>(size);
}

int pthread_cond_clockwait(pthread_cond_t*, pthread_mutex_t* mutex, clockid_t, const timespec* deadline) {
  const Nanos until = deadline->tv_sec * kSecond + deadline->tv_nsec;
  if (network().now() >= until) return ETIMEDOUT;
  ::pthread_mutex_unlock(mutex);
  network().wait(until, true);
  ::pthread_mutex_lock(mutex);
  if (!network().running()->alive) throw ProcessKilled{};
  return network().now() >= until ? ETIMEDOUT : 0;
}

}  // extern "C"

std::chrono::steady_clock::time_point std::chrono::steady_clock::now() noexcept {
  if (Network::current() != nullptr) return time_point(nanoseconds(Network::current()->now()));
  timespec time{};
  ::clock_gettime(CLOCK_MONOTONIC, &time);
  return time_point(seconds(time.tv_sec) + nanoseconds(time.tv_nsec));
}
