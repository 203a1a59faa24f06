// SPDX-License-Identifier: Apache-2.0
#include "compat/context_registry.h"

#include <cstdint>
#include <unordered_map>
#include <utility>

namespace earshot::compat {
namespace {

struct Registry {
  std::mutex mutex;
  std::uintptr_t last = 0;
  std::unordered_map<std::uintptr_t, std::shared_ptr<SharedContext>> contexts;
};

/// Never destroyed: a thread of the caller may still call while the process ends.
Registry& registry() {
  static auto* const all = new Registry;
  return *all;
}

std::uintptr_t number_of(RLRA_Context handle) { return reinterpret_cast<std::uintptr_t>(handle); }

}  // namespace

RLRA_Context add_context(std::shared_ptr<SharedContext> context) {
  Registry& all = registry();
  const std::lock_guard lock(all.mutex);
  const std::uintptr_t number = ++all.last;
  all.contexts.emplace(number, std::move(context));
  return reinterpret_cast<RLRA_Context>(number);  // NOLINT(performance-no-int-to-ptr): a number behind an opaque type
}

std::shared_ptr<SharedContext> find_context(RLRA_Context handle) {
  Registry& all = registry();
  const std::lock_guard lock(all.mutex);
  const auto found = all.contexts.find(number_of(handle));
  return found == all.contexts.end() ? nullptr : found->second;
}

bool remove_context(RLRA_Context handle) {
  std::shared_ptr<SharedContext> removed;  // destroyed outside the lock
  Registry& all = registry();
  const std::lock_guard lock(all.mutex);
  const auto found = all.contexts.find(number_of(handle));
  if (found == all.contexts.end()) return false;
  removed = std::move(found->second);
  all.contexts.erase(found);
  return true;
}

}  // namespace earshot::compat
