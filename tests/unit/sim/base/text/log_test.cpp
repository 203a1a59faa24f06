// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace earshot {
namespace {

using testing::HasSubstr;

TEST(Log, WritesTheMessageAsItIsWithItsLevel) {
  testing::internal::CaptureStdout();
  log_info("began {} of {}");
  log_warning("no peer at {:d}");
  log_error("100 % lost");
  const std::string text = testing::internal::GetCapturedStdout();
  EXPECT_THAT(text, HasSubstr("info"));
  EXPECT_THAT(text, HasSubstr("began {} of {}\n"));
  EXPECT_THAT(text, HasSubstr("warning"));
  EXPECT_THAT(text, HasSubstr("no peer at {:d}\n"));
  EXPECT_THAT(text, HasSubstr("error"));
  EXPECT_THAT(text, HasSubstr("100 % lost\n"));
}

}  // namespace
}  // namespace earshot
