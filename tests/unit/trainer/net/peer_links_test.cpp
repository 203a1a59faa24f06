// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/peer_links.h"

#include <gtest/gtest.h>

namespace earshot {
namespace {

PeerFrame frame_of(int rank, std::uint32_t epoch, std::uint64_t sequence, std::uint32_t step = 0) {
  PeerFrame frame;
  frame.from = rank;
  frame.header.epoch = epoch;
  frame.header.sequence = sequence;
  frame.header.step = step;
  return frame;
}

TEST(KeptFrames, GivesThoseOfACallByRankInTheirOrder) {
  KeptFrames kept;
  kept.put(frame_of(3, 0, 7, 1));
  kept.put(frame_of(1, 0, 7, 1));
  kept.put(frame_of(1, 0, 7, 2));
  kept.put(frame_of(1, 0, 8, 1));
  EXPECT_EQ(kept.num_peers(0, 7), 2);
  EXPECT_EQ(kept.num_peers(0, 8), 0);  // behind one of an earlier call
  EXPECT_FALSE(kept.take(0, 8));
  std::vector<std::pair<int, std::uint32_t>> taken;
  while (const auto frame = kept.take(0, 7)) taken.emplace_back(frame->from, frame->header.step);
  EXPECT_EQ(taken, (std::vector<std::pair<int, std::uint32_t>>{{1, 1}, {1, 2}, {3, 1}}));
  EXPECT_EQ(kept.num_peers(0, 8), 1);
  EXPECT_FALSE(kept.take(1, 8));  // of another view
  EXPECT_TRUE(kept.take(0, 8));
  EXPECT_FALSE(kept.take(0, 8));
}

TEST(KeptFrames, DropsEarlierViewsAndPeersThatAreForgotten) {
  KeptFrames kept;
  kept.put(frame_of(1, 0, 5));
  kept.put(frame_of(1, 1, 0));
  kept.put(frame_of(2, 1, 0));
  kept.drop_before(1);
  EXPECT_FALSE(kept.take(0, 5));
  EXPECT_EQ(kept.num_peers(1, 0), 2);
  kept.forget(1);
  const auto frame = kept.take(1, 0);
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->from, 2);
  EXPECT_FALSE(kept.take(1, 0));
}

}  // namespace
}  // namespace earshot
