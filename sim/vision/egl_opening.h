// SPDX-License-Identifier: Apache-2.0
#pragma once

// Opening devices in this process, which a broken driver can end; for the process that probes them.

#include "sim/vision/egl_device.h"

namespace earshot {

/// Number of devices that EGL lists.
int count_egl_devices();

/// Makes a context on a device and drops it.  index: below count_egl_devices(), or EglDevice::kSurfaceless.
EglDevice open_egl_device(int index);

}  // namespace earshot
