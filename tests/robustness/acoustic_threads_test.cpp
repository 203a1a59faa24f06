// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <vector>

#include "tests/support/acoustics/acoustic_engines.h"

namespace earshot {
namespace {

using namespace engines;

TEST(H49_ThreadCounts, OneTwoAndSixtyFourGiveTheSameBits) {
  for (const Engine engine : kEngines) {
    SCOPED_TRACE(name_of(engine));
    std::vector<float> one_thread;
    for (const int threads : {1, 2, 64}) {
      AcousticConfig config;  // octaves, air, image paths, first-order harmonics
      config.rays = 1500;
      config.threads = threads;
      const Heard heard(engine, rooms::shoe1(0.2, 0.3), config, rooms::shoe1_source(), 2048);
      const std::vector<float> bits = bits_of(heard.at(rooms::shoe1_listener()));
      if (threads == 1) one_thread = bits;
      EXPECT_TRUE(same_bits(one_thread, bits)) << threads;
    }
  }
}

}  // namespace
}  // namespace earshot
