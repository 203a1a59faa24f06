// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "sim/base/processor.h"

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
  FloatControl before_;
};

/// For the start of a thread that only computes: the setting lasts until the thread ends.
inline void flush_denormals_on_this_thread();

inline bool denormals_are_flushed() { return kFlushDenormals != 0 && (read_float_control() & kFlushDenormals) == kFlushDenormals; }

inline FlushDenormals::FlushDenormals() : before_(read_float_control()) {
  if ((before_ & kFlushDenormals) != kFlushDenormals) write_float_control(before_ | kFlushDenormals);
}
inline FlushDenormals::~FlushDenormals() {
  // Only these bits: exception flags that were raised in between stay set.
  if ((before_ & kFlushDenormals) != kFlushDenormals)
    write_float_control((read_float_control() & ~kFlushDenormals) | (before_ & kFlushDenormals));
}

inline void flush_denormals_on_this_thread() { write_float_control(read_float_control() | kFlushDenormals); }

}  // namespace earshot
