#include "trainer/tree_shape.h"

#include <algorithm>

#include "sim/base/errors.h"

namespace earshot {
namespace {

std::vector<TreeNode::Subtree> children_of(const TreeNode::Subtree& subtree) {
  const int below = subtree.size() - 1, number = std::min(kTreeChildren, below);
  std::vector<TreeNode::Subtree> children;
  for (int i = 0; i < number; ++i)
    children.push_back({subtree.first + 1 + below * i / number, subtree.first + 1 + below * (i + 1) / number});
  return children;
}

}  // namespace

std::vector<int> TreeNode::neighbours() const {
  std::vector<int> ranks;
  if (parent >= 0) ranks.push_back(parent);
  for (const Subtree& child : children) ranks.push_back(child.first);
  return ranks;
}

TreeNode tree_node(int rank, int world_size) {
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

int tree_depth(int world_size) {
  int depth = 0;
  // The last child of each is the largest.
  for (TreeNode::Subtree subtree{0, world_size}; subtree.size() > 1; ++depth) subtree = children_of(subtree).back();
  return depth;
}

}  // namespace earshot
