// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/accuracy/accuracy_target.h"

#include <gtest/gtest.h>

#include <cmath>

#include "sim/base/errors.h"

namespace earshot {
namespace {

TEST(AccuracyTarget, ReadsWhatIsAskedFor) {
  const AccuracyTarget target = AccuracyTarget::parse("t20=5%,edc=0.75dB");
  EXPECT_DOUBLE_EQ(target.of(AccuracyKind::t20).value(), 0.05);
  EXPECT_FALSE(target.of(AccuracyKind::drr));
  EXPECT_DOUBLE_EQ(target.of(AccuracyKind::edc).value(), 0.75);
  EXPECT_EQ(target.text(), "t20=5%,edc=0.75dB");
  EXPECT_EQ(AccuracyTarget::parse(target.text()).text(), target.text());
}

TEST(AccuracyTarget, SaysHowMuchOfItErrorsUse) {
  const AccuracyTarget target = AccuracyTarget::parse("t20=5%,drr=1dB");
  EXPECT_DOUBLE_EQ(target.used({0.04, 0.5, 99}), 0.8);
  EXPECT_DOUBLE_EQ(target.used({0.01, 2, 0}), 2);
  EXPECT_DOUBLE_EQ(target.used({std::nan(""), 0.5, 0}), 0.5) << "no decay where there is none";
  EXPECT_EQ(text_of({0.039, std::nan(""), 0.41}), "t20 3.9 %, edc 0.41 dB");
}

TEST(AccuracyTarget, RefusesWhatIsNoTarget) {
  for (const char* text : {"", "t20", "t20=5", "t20=5dB", "t20=%", "t20=5%,", "t30=5%", "t20=0.5%", "t20=51%", "t20=nan%", "t20=-5%",
                           "drr=1", "drr=0.01dB", "drr=11dB", "t20=5%,t20=6%", "t20=5% ,drr=1dB", "t20=1e400%"})
    EXPECT_THROW((void)AccuracyTarget::parse(text), InputError) << text;
}

}  // namespace
}  // namespace earshot
