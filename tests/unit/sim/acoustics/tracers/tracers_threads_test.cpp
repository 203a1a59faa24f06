// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/acoustics/bidirectional_field.h"
#include "tests/support/acoustics/late_field.h"
#include "tests/support/acoustics/rooms.h"

// Both tracers give the bits of one thread on any number of them.

namespace earshot {
namespace {

using rooms::bidirectional_field;
using rooms::BidirectionalField;
using rooms::late_field;

TEST(PathTracer, ThreadsGiveTheSameBitsH49) {
  AcousticConfig config;
  config.rays = 1500;  // six chunks, the last one short
  const auto room = rooms::shoe1(0.2, 0.3);
  const EnergyHistogram one_thread = late_field(room, config, rooms::shoe1_source(), rooms::shoe1_listener());
  for (const int threads : {2, 3, 0}) {
    config.threads = threads;
    const EnergyHistogram many_threads = late_field(room, config, rooms::shoe1_source(), rooms::shoe1_listener());
    EXPECT_TRUE(std::equal(one_thread.values().begin(), one_thread.values().end(), many_threads.values().begin())) << threads << " threads";
    EXPECT_EQ(one_thread.dropped_energy(), many_threads.dropped_energy());
  }
}

TEST(Bidirectional, AnyNumberOfThreadsGivesTheSameBits) {
  AcousticConfig config;
  config.rays = 1000;  // not a multiple of the batches
  config.source_rays = 77;
  const auto room = rooms::shoe1(0.2, 0.3);
  const BidirectionalField one_thread = bidirectional_field(room, config, rooms::shoe1_source(), rooms::shoe1_listener());
  for (const int threads : {2, 3, 0}) {
    config.threads = threads;
    double last_fraction = 0;
    int calls = 0;
    const BidirectionalField many_threads =
        bidirectional_field(room, config, rooms::shoe1_source(), rooms::shoe1_listener(), {.progress = [&](double fraction) {
                              EXPECT_GT(fraction, last_fraction);
                              last_fraction = fraction;
                              ++calls;
                            }});
    EXPECT_TRUE(
        std::equal(one_thread.histogram.values().begin(), one_thread.histogram.values().end(), many_threads.histogram.values().begin()))
        << threads;
    EXPECT_EQ(one_thread.batches.energy, many_threads.batches.energy);
    EXPECT_EQ(one_thread.stats.ray_hits, many_threads.stats.ray_hits);
    EXPECT_EQ(last_fraction, 1.0);
    EXPECT_EQ(calls, 16);
  }
}

}  // namespace
}  // namespace earshot
