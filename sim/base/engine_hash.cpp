// SPDX-License-Identifier: Apache-2.0
#include "sim/base/engine_hash.h"

#include "sim/base/files.h"

namespace earshot {

std::string engine_hash() { return hex64(hash64(read_file("/proc/self/exe"))); }

}  // namespace earshot
