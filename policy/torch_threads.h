// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace earshot {

/// Sets torch up for a worker that owns one core; call once in main, before the first tensor.
///   - one thread in torch and in OpenBLAS (which torch's own setting does not reach): more would fight with the other workers, and sums
///   would
///     depend on the number (docs/explanation/ppo.md, section 4);
///   - denormals flushed to zero on the calling thread (sim/base/denormals.h): backward runs on the thread that calls it, and there are no
///   others;
///   - freed memory kept in the process: the activations of a minibatch are tens of megabytes per layer, and the kernel would clear those
///   pages
///     anew each time.
void use_one_torch_thread();

}  // namespace earshot
