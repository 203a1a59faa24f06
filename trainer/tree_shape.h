#pragma once

#include <vector>

namespace earshot {

/// A tree over ranks in which every subtree is an interval of ranks that begins with its root: what a worker gathers from its children, its
/// own part first, is in rank order already.
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

TreeNode tree_node(int rank, int world_size);

/// Levels of the tree below its root: 2 from 10 workers, 3 from 74, 4 from 586.
int tree_depth(int world_size);

}  // namespace earshot
