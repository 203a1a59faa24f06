// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <thread>
#include <vector>

#include "tests/support/acoustics/field_store_fixture.h"

namespace earshot {
namespace {

TEST_F(FieldStore, ThreadsWaitForOneField) {
  SourceFieldStore store(config());
  std::vector<std::shared_ptr<const SourceField>> fields(6);
  {
    std::vector<std::jthread> threads;
    for (auto& field : fields) threads.emplace_back([&] { field = store.get(room_, source_); });
  }
  for (const auto& field : fields) EXPECT_EQ(field, fields[0]);
  EXPECT_EQ(store.counters().built, 1u);
  EXPECT_EQ(store.counters().shared, 5u);
}

// What processes do that share a folder: none of these stores knows of another.
TEST_F(FieldStore, StoresThatShareAFolderBuildAFieldOnce) {
  constexpr std::size_t kStores = 4;
  std::vector<std::unique_ptr<SourceFieldStore>> stores;
  for (std::size_t i = 0; i < kStores; ++i) stores.push_back(std::make_unique<SourceFieldStore>(config()));
  std::vector<std::shared_ptr<const SourceField>> fields(kStores);
  {
    std::vector<std::jthread> threads;
    for (std::size_t i = 0; i < kStores; ++i) threads.emplace_back([&, i] { fields[i] = stores[i]->get(room_, source_); });
  }
  std::uint64_t built = 0, loaded = 0;
  for (const auto& store : stores) {
    built += store->counters().built;
    loaded += store->counters().loaded;
  }
  EXPECT_EQ(built, 1u);
  EXPECT_EQ(loaded, kStores - 1);
  for (const auto& field : fields) EXPECT_TRUE(std::ranges::equal(field->image(), fields[0]->image()));
  EXPECT_EQ(files().size(), 1u);  // the locks are gone
}

}  // namespace
}  // namespace earshot
