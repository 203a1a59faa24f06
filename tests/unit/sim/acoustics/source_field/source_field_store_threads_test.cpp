#include <gtest/gtest.h>

#include <thread>
#include <vector>

#include "tests/support/field_store_fixture.h"

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

}  // namespace
}  // namespace earshot
