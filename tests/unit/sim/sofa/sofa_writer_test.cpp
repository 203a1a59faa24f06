// SPDX-License-Identifier: Apache-2.0
// SOFA files, read back by libmysofa, which reads HDF5 by code of its own.

#include "sim/sofa/sofa_writer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <mysofa.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

/// Long enough that the headers of the file do not count.
SofaRoomResponses three_listeners() {
  SofaRoomResponses responses;
  responses.title = "three";
  responses.room_description = "a box";
  responses.sample_rate_hz = 16000;
  responses.num_receivers = 2;
  responses.num_samples = 5000;
  for (int i = 0; i < 3 * 2 * 5000; ++i) responses.samples.push_back(static_cast<float>((i * 37) % 101) / 101.f - 0.5f);
  responses.source = {.position = {1, 2, 1.5}, .view = {0, 1, 0}, .up = {0, 0, 1}};
  for (int i = 0; i < 3; ++i) responses.listeners.push_back({.position = {0.5 * i, -1, 1.25}, .view = {0, -1, 0}, .up = {0, 0, 1}});
  responses.receivers = {{.position = {0, 0.09, 0}, .view = {0, 1, 0}}, {.position = {0, -0.09, 0}, .view = {0, -1, 0}}};
  responses.shoebox = {{0, -3, 0}, {4, 3, 2.5}};
  return responses;
}

struct Free {
  void operator()(MYSOFA_HRTF* hrtf) const { mysofa_free(hrtf); }
};

std::string attribute(const MYSOFA_ATTRIBUTE* list, const char* name) {
  for (; list; list = list->next)
    if (std::strcmp(list->name, name) == 0) return list->value ? list->value : "";
  return "none of that name";
}

TEST(SofaWriter, AnotherReaderFindsWhatWasWritten) {
  if (!can_write_sofa()) GTEST_SKIP() << "this build has no HDF5";
  const SofaRoomResponses written = three_listeners();
  const std::filesystem::path path = std::filesystem::temp_directory_path() / ("earshot_sofa_" + std::to_string(::getpid()) + ".sofa");
  write_file_atomically(path, encode_sofa(written, "room.sofa"));
  int status = 0;
  const std::unique_ptr<MYSOFA_HRTF, Free> read(mysofa_load(path.c_str(), &status));
  std::filesystem::remove(path);
  ASSERT_TRUE(read) << status;
  EXPECT_EQ(read->M, 3u);
  EXPECT_EQ(read->R, 2u);
  EXPECT_EQ(read->E, 1u);
  EXPECT_EQ(read->N, 5000u);
  EXPECT_EQ(read->C, 3u);
  EXPECT_EQ(attribute(read->attributes, "SOFAConventions"), "SingleRoomSRIR");
  EXPECT_EQ(attribute(read->attributes, "RoomType"), "shoebox");
  EXPECT_EQ(attribute(read->attributes, "Title"), "three");
  ASSERT_EQ(read->DataIR.elements, written.samples.size());
  for (std::size_t i = 0; i < written.samples.size(); ++i) ASSERT_EQ(read->DataIR.values[i], written.samples[i]) << i;
  ASSERT_EQ(read->ListenerPosition.elements, 9u);
  EXPECT_EQ(read->ListenerPosition.values[6], 1.f);
  EXPECT_EQ(read->ListenerPosition.values[7], -1.f);
  EXPECT_EQ(attribute(read->ListenerPosition.attributes, "Type"), "cartesian");
  ASSERT_EQ(read->SourcePosition.elements, 9u);
  EXPECT_EQ(read->SourcePosition.values[4], 2.f);
  ASSERT_EQ(read->DataSamplingRate.elements, 1u);
  EXPECT_EQ(read->DataSamplingRate.values[0], 16000.f);
}

TEST(SofaWriter, TheSameResponsesAreTheSameBytes) {
  if (!can_write_sofa()) GTEST_SKIP() << "this build has no HDF5";
  SofaRoomResponses responses = three_listeners();
  const std::string bytes = encode_sofa(responses, "a");
  EXPECT_TRUE(encode_sofa(responses, "b") == bytes);
  EXPECT_EQ(bytes[8], 0);                                 // superblock 0 has no checksum, which HDF5's image of a file would not have right
  EXPECT_LT(bytes.size(), 8 * responses.samples.size());  // compressed: below its 64-bit numbers
  responses.samples[7] += 1;
  EXPECT_FALSE(encode_sofa(responses, "a") == bytes);
}

TEST(SofaWriter, WithoutHdf5OneLineSaysSo) {
  if (can_write_sofa()) GTEST_SKIP() << "built with HDF5";
  EXPECT_THROW(encode_sofa(three_listeners(), "room.sofa"), InputError);
}

}  // namespace
}  // namespace earshot
