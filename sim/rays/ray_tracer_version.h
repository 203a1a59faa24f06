#pragma once

#include <string>

namespace earshot {

/// Version of the Embree in use, such as "4.3.3".  Throws InputError if Embree opens no device.
std::string ray_tracer_version();

}  // namespace earshot
