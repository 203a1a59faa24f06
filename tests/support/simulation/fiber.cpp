// SPDX-License-Identifier: Apache-2.0
#include "tests/support/simulation/fiber.h"

#include <cxxabi.h>

#include <cstdint>
#include <cstring>
#include <utility>
#include <vector>

namespace earshot::simulation {
namespace {

constexpr std::size_t kStackBytes = std::size_t{512} << 10;

/// Stacks that ended fibers leave to the next ones.
std::vector<std::unique_ptr<std::byte[]>>& spare_stacks() {
  static std::vector<std::unique_ptr<std::byte[]>> stacks;
  return stacks;
}

}  // namespace

Fiber::Fiber(std::function<void()> body) : body_(std::move(body)) {
  auto& spare = spare_stacks();
  if (spare.empty()) {
    stack_.reset(new std::byte[kStackBytes]);
  } else {
    stack_ = std::move(spare.back());
    spare.pop_back();
  }
  ::getcontext(&inside_);
  inside_.uc_stack.ss_sp = stack_.get();
  inside_.uc_stack.ss_size = kStackBytes;
  inside_.uc_link = &outside_;
  const auto self = reinterpret_cast<std::uintptr_t>(this);
  ::makecontext(&inside_, reinterpret_cast<void (*)()>(&Fiber::enter), 2, static_cast<unsigned int>(self >> 32),
                static_cast<unsigned int>(self));
}

Fiber::~Fiber() { spare_stacks().push_back(std::move(stack_)); }

void Fiber::enter(unsigned int high, unsigned int low) {
  auto* self = reinterpret_cast<Fiber*>(static_cast<std::uintptr_t>(high) << 32 | low);
  self->body_();
  self->ended_ = true;
}

void Fiber::swap_exceptions() {
  auto* of_thread = reinterpret_cast<ExceptionState*>(abi::__cxa_get_globals());
  std::swap(*of_thread, exceptions_);
}

void Fiber::resume() {
  swap_exceptions();
  ::swapcontext(&outside_, &inside_);
  swap_exceptions();
}

void Fiber::pause() { ::swapcontext(&inside_, &outside_); }

}  // namespace earshot::simulation
