// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>

namespace earshot {

/// Threads that help one other with the agents of its env.  For batches of fewer envs than threads; used by one thread at a time.
class AgentTeam {
 public:
  /// helpers: threads beside the one that calls; at least 1.
  explicit AgentTeam(std::size_t helpers);
  /// Waits for its threads.
  ~AgentTeam();
  AgentTeam(const AgentTeam&) = delete;
  AgentTeam& operator=(const AgentTeam&) = delete;

  /// body(item, member) for all items below `count`, each once, in any order and by any member; returns when all are done.  member: of
  /// the thread, 0 for the caller, up to the number of helpers.  body must not throw.  Takes no memory, whatever body captures.
  template <class Body>
  void run(std::size_t count, const Body& body) {
    run_calls(count, &body,
              [](const void* context, std::size_t item, std::size_t member) { (*static_cast<const Body*>(context))(item, member); });
  }

 private:
  using Call = void (*)(const void* body, std::size_t item, std::size_t member);
  void run_calls(std::size_t count, const void* body, Call call);

  struct Shared;
  std::unique_ptr<Shared> shared_;
};

}  // namespace earshot
