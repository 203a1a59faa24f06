// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <vector>

#include "sim/base/errors.h"

namespace earshot {

/// A tree over ranks in which every subtree is an interval of ranks that begins with its root: parts gathered from the children, after a
/// worker's own part, are already in rank order.
inline constexpr int kTreeChildren = 8;  ///< at most

struct TreeNode {
  struct Subtree {
    int first = 0, end = 0;  ///< its root, and one past its last rank
    [[nodiscard]] int size() const { return end - first; }
  };
  Subtree own;
  int parent = -1;                ///< -1: the root of all, rank 0
  int depth = 0;                  ///< of this node; 0 at the root
  std::vector<Subtree> children;  ///< by rank, sizes alike within one

  /// Parent and children.
  [[nodiscard]] std::vector<int> neighbours() const;
};

inline std::vector<TreeNode::Subtree> children_of(const TreeNode::Subtree& subtree) {
  const int below = subtree.size() - 1, number = std::min(kTreeChildren, below);
  std::vector<TreeNode::Subtree> children;
  for (int i = 0; i < number; ++i)
    children.push_back({subtree.first + 1 + below * i / number, subtree.first + 1 + below * (i + 1) / number});
  return children;
}

inline std::vector<int> TreeNode::neighbours() const {
  std::vector<int> ranks;
  if (parent >= 0) ranks.push_back(parent);
  for (const Subtree& child : children) ranks.push_back(child.first);
  return ranks;
}

inline TreeNode tree_node(int rank, int world_size) {
  EARSHOT_EXPECT(rank >= 0 && rank < world_size);
  TreeNode node;
  node.own = {0, world_size};
  node.children = children_of(node.own);
  while (node.own.first != rank) {
    const auto child = std::ranges::find_if(node.children, [rank](const auto& subtree) { return rank < subtree.end; });
    node.parent = node.own.first;
    node.own = *child;
    node.children = children_of(node.own);
    ++node.depth;
  }
  return node;
}

/// Levels of the tree below its root: 2 from 10 workers, 3 from 74, 4 from 586.
inline int tree_depth(int world_size) {
  int depth = 0;
  // The last child of each is the largest.
  for (TreeNode::Subtree subtree{0, world_size}; subtree.size() > 1; ++depth) subtree = children_of(subtree).back();
  return depth;
}

}  // namespace earshot
