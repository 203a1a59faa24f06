// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ucontext.h>

#include <cstddef>
#include <functional>
#include <memory>

namespace earshot::simulation {

/// A function on a stack of its own, which runs until it waits.  One thread runs all fibers; exceptions, thrown and caught, are each
/// fiber's own.
class Fiber {
 public:
  explicit Fiber(std::function<void()> body);
  ~Fiber();
  Fiber(const Fiber&) = delete;
  Fiber& operator=(const Fiber&) = delete;

  /// Runs the body until it calls pause() or returns.  Not from within a fiber.
  void resume();
  /// From within: goes back to resume().
  void pause();
  [[nodiscard]] bool has_ended() const { return ended_; }

 private:
  /// What the compiler keeps per thread (Itanium C++ ABI, __cxa_eh_globals).
  struct ExceptionState {
    void* caught = nullptr;
    unsigned int uncaught = 0;
  };
  static void enter(unsigned int high, unsigned int low);
  void swap_exceptions();

  std::function<void()> body_;
  std::unique_ptr<std::byte[]> stack_;
  ucontext_t inside_{}, outside_{};
  ExceptionState exceptions_;
  bool ended_ = false;
};

}  // namespace earshot::simulation
