// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/tree_shape.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

namespace earshot {
namespace {

TEST(TreeShape, SubtreesAreIntervalsOfRanksThatBeginWithTheirRoots) {
  for (const int world_size : {1, 2, 9, 10, 65, 73, 74, 96, 585, 586, 1000, 1024}) {
    std::vector<int> parents(static_cast<std::size_t>(world_size), -2);
    parents[0] = -1;
    int deepest = 0;
    for (int rank = 0; rank < world_size; ++rank) {
      const TreeNode node = tree_node(rank, world_size);
      EXPECT_EQ(node.own.first, rank);
      EXPECT_EQ(node.parent, parents[static_cast<std::size_t>(rank)])
          << rank << " of " << world_size;  // a parent comes before its children
      ASSERT_LE(node.children.size(), 8u);
      int next = rank + 1;
      for (const auto& child : node.children) {
        EXPECT_EQ(child.first, next);
        ASSERT_GT(child.size(), 0);
        parents[static_cast<std::size_t>(child.first)] = rank;
        next = child.end;
      }
      EXPECT_EQ(next, node.own.end);
      if (!node.children.empty()) {
        const auto [least, most] = std::ranges::minmax(node.children, {}, &TreeNode::Subtree::size);
        EXPECT_LE(most.size() - least.size(), 1);
      }
      EXPECT_EQ(node.neighbours().size(), node.children.size() + (node.parent >= 0 ? 1 : 0));
      deepest = std::max(deepest, node.depth);
    }
    EXPECT_EQ(tree_depth(world_size), deepest) << world_size;
  }
}

TEST(TreeShape, EightChildrenMakeAFlatTree) {
  // 1 + 8, 1 + 8 + 64, 1 + 8 + 64 + 512 workers fill one, two, three levels.
  EXPECT_EQ(tree_depth(1), 0);
  for (const auto& [world_size, depth] : {std::pair(9, 1), {10, 2}, {73, 2}, {74, 3}, {585, 3}, {586, 4}, {1024, 4}})
    EXPECT_EQ(tree_depth(world_size), depth) << world_size;
}

}  // namespace
}  // namespace earshot
