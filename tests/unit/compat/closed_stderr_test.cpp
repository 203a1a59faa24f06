// SPDX-License-Identifier: Apache-2.0
// Programs run with stderr closed: lines are lost, codes are not.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <vector>

#include "compat/rlr_audio_propagation.h"

namespace earshot {
namespace {

std::vector<RLRA_Error> codes_of_wrong_calls() {
  RLRA_ContextConfiguration configuration{};
  RLRA_Context context = nullptr;
  std::vector<RLRA_Error> codes = {RLRA_ContextConfigurationDefault(&configuration), RLRA_CreateContext(&context, &configuration)};
  const std::array<float, 3> place{1, 2, 3};
  codes.push_back(RLRA_SetSourcePosition(context, 7, place.data()));
  codes.push_back(RLRA_SetListenerPosition(context, 7, place.data()));
  codes.push_back(RLRA_SetSourcePosition(nullptr, 0, place.data()));
  codes.push_back(RLRA_Simulate(context));
  codes.push_back(RLRA_DestroyContext(context));
  return codes;
}

TEST(CompatErrors, AClosedOrFullStderrChangesNoCode) {
  const std::vector<RLRA_Error> open = codes_of_wrong_calls();
  const int former = dup(STDERR_FILENO);
  close(STDERR_FILENO);
  const std::vector<RLRA_Error> closed = codes_of_wrong_calls();
  const int full = ::open("/dev/full", O_WRONLY | O_CLOEXEC);
  dup2(full, STDERR_FILENO);
  const std::vector<RLRA_Error> on_full_disk = codes_of_wrong_calls();
  dup2(former, STDERR_FILENO);
  if (full != STDERR_FILENO) close(full);
  close(former);
  EXPECT_EQ(closed, open);
  EXPECT_EQ(on_full_disk, open);
  EXPECT_NE(open[2], RLRA_Success);
}

}  // namespace
}  // namespace earshot
