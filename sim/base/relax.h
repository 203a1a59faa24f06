#pragma once

namespace earshot {

/// For a loop that waits for another thread: lets the core's other hardware thread run, and saves power.
inline void relax() {
#if defined(__x86_64__)
  __builtin_ia32_pause();
#elif defined(__aarch64__)
  asm volatile("yield");
#endif
}

}  // namespace earshot
