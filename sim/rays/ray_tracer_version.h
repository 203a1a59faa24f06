// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace earshot {

/// Version of the Embree in use, such as "4.3.3".  Throws InputError if Embree opens no device.
std::string ray_tracer_version();

/// The instruction set that Embree uses in this process, by its name in ray_isas(): EARSHOT_ISA where that is set (embree_options.h),
/// otherwise the widest that the processor and the library have; "neon" on arm64.  Throws InputError if Embree opens no device.
std::string ray_tracer_isa();

}  // namespace earshot
