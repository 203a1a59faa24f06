// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <string>
#include <thread>
#include <vector>

#include "sim/scene/generators/shoebox.h"
#include "sim/scene/point_cloud/cloud_import.h"
#include "tests/support/files/cloud_files.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

TEST(CloudImportThreads, ManyAtOnceGiveTheSameBits) {
  const TempFolder folder;
  const std::string path = folder.write("box.ply", ply_points(sample_surface(make_shoebox({4, 3, 5}), 20'000, 0.01, 9)));
  const std::uint64_t alone = hash_of(import_point_cloud(path, {.cell_m = 0.15}).mesh);
  std::vector<std::uint64_t> hashes(4);
  {
    std::vector<std::jthread> threads;
    for (std::uint64_t& hash : hashes) threads.emplace_back([&] { hash = hash_of(import_point_cloud(path, {.cell_m = 0.15}).mesh); });
  }
  for (const std::uint64_t hash : hashes) EXPECT_EQ(hash, alone);
}

}  // namespace
}  // namespace earshot
