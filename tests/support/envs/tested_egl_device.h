// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdlib>
#include <string>

namespace earshot {

/// The device that the tests of pictures by EGL draw on: EARSHOT_TEST_EGL_DEVICE, as `earshot render --device` takes it, or Mesa's.
inline std::string tested_egl_device() {
  const char* device = std::getenv("EARSHOT_TEST_EGL_DEVICE");
  return device ? device : "software";
}

}  // namespace earshot
