// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <thread>
#include <vector>

#include "tests/support/files/image_store_fixture.h"

namespace earshot {
namespace {

TEST_F(ImageStoreTest, ThreadsMaySaveAndLoadAtOnce) {
  const auto image = image_of(17, 3000);
  ImageStore store = open(10 * 3064);
  {
    std::vector<std::jthread> threads;
    for (std::uint64_t i = 0; i < 4; ++i)
      threads.emplace_back([&, i] {
        for (std::uint64_t round = 0; round < 50; ++round) {
          EXPECT_TRUE(store.save((i + round) % 20, image));
          const auto loaded = store.load(round % 20);
          EXPECT_TRUE(!loaded || equal(loaded->bytes, image));
        }
      });
  }
  EXPECT_LE(num_files(), 11u);
  EXPECT_TRUE(warnings_.empty());
}

}  // namespace
}  // namespace earshot
