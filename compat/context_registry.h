// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <mutex>

#include "compat/context.h"
#include "compat/rlr_audio_propagation.h"

namespace earshot::compat {

/// A context, and the lock that a call holds.
struct SharedContext {
  explicit SharedContext(const RLRA_ContextConfiguration& configuration) : context(configuration) {}
  std::mutex mutex;
  Context context;
};

// All contexts of the process: a C interface has handles, which must be told from wrong ones.  Any thread.

/// The handle is a number that is given out once, so that one of a destroyed context never names another.
RLRA_Context add_context(std::shared_ptr<SharedContext> context);
/// Null for a handle that names none.
std::shared_ptr<SharedContext> find_context(RLRA_Context handle);
/// Whether the handle named one.  A call that still runs ends as usual.
bool remove_context(RLRA_Context handle);

}  // namespace earshot::compat
