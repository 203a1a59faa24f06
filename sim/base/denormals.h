#pragma once

#if defined(__x86_64__)
#include <xmmintrin.h>
#endif

namespace earshot {

// The one setting for denormals (numbers below 1.2e-38 in float): flushed to zero, as results (FTZ) and as operands (DAZ), wherever Earshot
// computes.  Decaying sound passes through them, where an addition costs a hundred cycles and more, and what one thread flushes and another
// keeps would make bits depend on which thread ran.  The setting belongs to a thread, so every function that computes holds a
// FlushDenormals, and so does every piece of work handed to TBB: TBB runs tasks under the setting of the thread that made the arena, not of
// the one that waits for them.

/// Whether this thread flushes denormals, results and operands.
inline bool denormals_are_flushed();

/// Flushes denormals on this thread for the lifetime of the object; the destructor restores the setting.  A few cycles if already set.
class FlushDenormals {
 public:
  FlushDenormals();
  ~FlushDenormals();
  FlushDenormals(const FlushDenormals&) = delete;
  FlushDenormals& operator=(const FlushDenormals&) = delete;

 private:
  unsigned before_ = 0;
};

/// For the start of a thread that only computes: the setting lasts until the thread ends.
inline void flush_denormals_on_this_thread();

#if defined(__x86_64__)

/// Of MXCSR: flush to zero (bit 15) and denormals are zero (bit 6).
inline constexpr unsigned kFlushBits = 0x8040u;

inline bool denormals_are_flushed() { return (_mm_getcsr() & kFlushBits) == kFlushBits; }

inline FlushDenormals::FlushDenormals() : before_(_mm_getcsr()) {
  if ((before_ & kFlushBits) != kFlushBits) _mm_setcsr(before_ | kFlushBits);
}
inline FlushDenormals::~FlushDenormals() {
  // Only the two bits: exception flags that were raised in between stay set.
  if ((before_ & kFlushBits) != kFlushBits) _mm_setcsr((_mm_getcsr() & ~kFlushBits) | (before_ & kFlushBits));
}

inline void flush_denormals_on_this_thread() { _mm_setcsr(_mm_getcsr() | kFlushBits); }

#else  // elsewhere denormals are computed with on every thread: as reproducible, and slower

inline bool denormals_are_flushed() { return false; }
inline FlushDenormals::FlushDenormals() = default;
inline FlushDenormals::~FlushDenormals() = default;
inline void flush_denormals_on_this_thread() {}

#endif

}  // namespace earshot
