// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/source_field/source_field_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/scene/scene.h"
#include "tests/support/acoustics/field_store_fixture.h"

namespace earshot {
namespace {

using testing::HasSubstr;

std::vector<float> hear(const SourceField& field, const AcousticScene& scene) {
  EnergyHistogram histogram = make_histogram(scene);
  field.gather(scene, {4.5f, 1.2f, 2.7f}, histogram);
  const auto values = histogram.values();
  return {values.begin(), values.end()};
}

bool same_image(const SourceField& a, const SourceField& b) { return std::ranges::equal(a.image(), b.image()); }

TEST_F(FieldStore, AFieldHasTheSameBitsBuiltLoadedAndWithoutAStore) {
  const auto alone = build_source_field(room_, source_);
  SourceFieldStore memory({});
  SourceFieldStore first(config()), second(config());
  const auto from_memory = memory.get(room_, source_), cold = first.get(room_, source_), warm = second.get(room_, source_);
  EXPECT_EQ(first.counters().built, 1u);
  EXPECT_EQ(first.counters().loaded, 0u);
  EXPECT_EQ(second.counters().built, 0u);
  EXPECT_EQ(second.counters().loaded, 1u);
  EXPECT_EQ(second.counters().bytes, alone->image().size());
  ASSERT_GT(alone->image().size(), 1000u);
  const auto heard = hear(*alone, room_);
  EXPECT_GT(std::ranges::max(heard), 0.f);
  for (const auto& field : {from_memory, cold, warm}) {
    EXPECT_TRUE(same_image(*field, *alone));
    EXPECT_EQ(hear(*field, room_), heard);
    EXPECT_EQ(field->photons(), alone->photons());
    EXPECT_EQ(field->t20_error(), alone->t20_error());
  }
  EXPECT_TRUE(warnings_.empty());
}

TEST_F(FieldStore, OtherScenesSourcesAndConfigsHaveOtherFiles) {
  SourceFieldStore store(config());
  store.get(room_, source_);
  AcousticConfig other = quick_config();
  other.field_cell_m = 0.7f;
  const AcousticScene coarse = load_room(other), larger = load_room(quick_config(), "shoebox:6x3x4.1@0.3"),
                      harder = load_room(quick_config(), "shoebox:6x3x4@0.2");
  store.get(coarse, EarlyCandidates(coarse, glm::vec3{1.5f, 1.4f, 1.1f}));
  store.get(larger, EarlyCandidates(larger, glm::vec3{1.5f, 1.4f, 1.1f}));
  store.get(harder, EarlyCandidates(harder, glm::vec3{1.5f, 1.4f, 1.1f}));
  store.get(room_, EarlyCandidates(room_, glm::vec3{1.6f, 1.4f, 1.1f}));
  EXPECT_EQ(store.counters().built, 5u);
  EXPECT_EQ(files().size(), 5u);
  AcousticConfig threads = quick_config();
  threads.threads = 2;  // no part of what is stored
  const AcousticScene parallel = load_room(threads);
  store.get(parallel, EarlyCandidates(parallel, glm::vec3{1.5f, 1.4f, 1.1f}));
  EXPECT_EQ(store.counters().built, 5u);
}

TEST_F(FieldStore, ADamagedFileIsBuiltAnewWithOneWarning) {
  SourceFieldStore writer(config());
  const auto before = writer.get(room_, source_);
  ASSERT_EQ(files().size(), 1u);
  {
    std::fstream file(files()[0], std::ios::binary | std::ios::in | std::ios::out);
    file.seekp(static_cast<std::streamoff>(std::filesystem::file_size(files()[0]) / 2));
    file.write("damage", 6);
  }
  SourceFieldStore reader(config()), later(config());
  const std::vector<std::byte> expected = [&] {
    const auto alone = build_source_field(room_, source_);
    return std::vector<std::byte>(alone->image().begin(), alone->image().end());
  }();
  EXPECT_TRUE(std::ranges::equal(reader.get(room_, source_)->image(), expected));
  EXPECT_EQ(reader.counters().built, 1u);
  EXPECT_EQ(warnings_.size(), 1u);
  EXPECT_TRUE(std::ranges::equal(later.get(room_, source_)->image(), expected));
  EXPECT_EQ(later.counters().loaded, 1u);
  EXPECT_EQ(warnings_.size(), 1u);
}

TEST_F(FieldStore, AFolderThatCannotBeWrittenLeavesFieldsInMemory) {
  std::ofstream(folder_) << "a file";
  SourceFieldStore store(config());
  EXPECT_TRUE(same_image(*store.get(room_, source_), *build_source_field(room_, source_)));
  store.get(room_, source_);
  EXPECT_EQ(warnings_.size(), 1u);
  EXPECT_EQ(store.counters().built, 2u);  // no caller held the first
}

TEST_F(FieldStore, HeldFieldsAreSharedAndOthersWithinTheBoundKept) {
  const EarlyCandidates second(room_, glm::vec3{2.5f, 1.4f, 1.1f}), third(room_, glm::vec3{3.5f, 1.4f, 1.1f});
  const auto size = [&](const EarlyCandidates& source) { return build_source_field(room_, source)->image().size(); };
  const std::size_t room_for_two = size(source_) + size(second) + size(third) - 1;
  SourceFieldStore store({.folder = {}, .max_bytes = 0, .max_memory_bytes = room_for_two, .warn = {}});
  {
    const auto held = store.get(room_, source_);
    EXPECT_EQ(store.get(room_, source_), held);
  }
  store.get(room_, source_);  // no caller held it, the store did
  EXPECT_EQ(store.counters().built, 1u);
  EXPECT_EQ(store.counters().shared, 2u);
  const auto held = store.get(room_, second);
  store.get(room_, source_);
  store.get(room_, third);  // the second was used longest ago
  EXPECT_EQ(store.cached_bytes(), room_for_two + 1 - size(second));
  store.get(room_, source_);
  store.get(room_, third);
  EXPECT_EQ(store.counters().built, 3u);
  EXPECT_EQ(store.get(room_, second), held);  // dropped by the store, held here
  EXPECT_EQ(store.counters().built, 3u);
}

TEST_F(FieldStore, ProcessesThatBuildTheSameFieldAgree) {
  std::vector<pid_t> children;
  for (int i = 0; i < 3; ++i) {
    const pid_t child = ::fork();
    if (child == 0) {
      SourceFieldStore store(config());
      const auto field = store.get(room_, source_);
      ::_exit(warnings_.empty() && same_image(*field, *build_source_field(room_, source_)) ? 0 : 1);
    }
    children.push_back(child);
  }
  for (const pid_t child : children) {
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  }
  SourceFieldStore store(config());
  EXPECT_TRUE(same_image(*store.get(room_, source_), *build_source_field(room_, source_)));
  EXPECT_EQ(store.counters().loaded, 1u);
  EXPECT_EQ(files().size(), 1u);
}

TEST_F(FieldStore, FieldsOutliveTheirStoreAndTheirFile) {
  std::shared_ptr<const SourceField> field;
  {
    SourceFieldStore store(config());
    field = store.get(room_, source_);
  }
  std::filesystem::remove_all(folder_);
  EXPECT_EQ(hear(*field, room_), hear(*build_source_field(room_, source_), room_));
}

}  // namespace
}  // namespace earshot
