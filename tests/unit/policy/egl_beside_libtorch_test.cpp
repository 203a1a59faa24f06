// SPDX-License-Identifier: Apache-2.0
// Mesa's driver in a process that has libtorch loaded, whose copy of LLVM must not answer the driver's calls.
#include <gtest/gtest.h>

#include <algorithm>

#include "policy/torch_info.h"
#include "sim/vision/egl_context.h"
#include "sim/vision/egl_device.h"

namespace earshot {
namespace {

TEST(EglBesideLibtorch, SoftwareRendererOpens) {
  EXPECT_FALSE(probe_torch().version.empty());
  const std::vector<EglDevice> devices = list_egl_devices();
  const bool has_software =
      std::ranges::any_of(devices, [](const EglDevice& device) { return device.software && !device.renderer.empty(); });
  if (!has_software) GTEST_SKIP() << "no software renderer: apt-get install libgl1-mesa-dri";
  const EglContext context("software");
  EXPECT_TRUE(is_software_renderer(context.renderer())) << context.renderer();
}

}  // namespace
}  // namespace earshot
