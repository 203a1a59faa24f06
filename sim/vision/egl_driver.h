// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace earshot {

/// Loads Mesa's driver so that it finds its own LLVM, if another library of this process exports LLVM's functions: libtorch 2.6 of Debian
/// 13 does, and Mesa's calls would initialize that copy and crash on their own.  Call it before the first call of EGL.  Does nothing
/// without this library or without Mesa; any thread, repeatedly.
void keep_driver_symbols_apart();

}  // namespace earshot
