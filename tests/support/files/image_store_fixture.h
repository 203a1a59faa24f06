// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <span>
#include <string>
#include <vector>

#include "sim/base/image_store.h"
#include "sim/base/random.h"

namespace earshot {

/// `size` bytes, a function of the seed.
inline std::vector<std::byte> image_of(std::uint32_t seed, std::size_t size = 5000) {
  const RandomStream random(seed, Purpose::test);
  std::vector<std::byte> bytes(size);
  for (std::size_t i = 0; i < size; ++i) bytes[i] = static_cast<std::byte>(random.bits(static_cast<std::uint32_t>(i)));
  return bytes;
}

inline bool equal(std::span<const std::byte> a, std::span<const std::byte> b) { return std::ranges::equal(a, b); }

/// A folder for stores and the warnings they gave.
class ImageStoreTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() /
              ("earshot_images_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()) + std::to_string(::getpid()));
    std::filesystem::remove_all(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  ImageStore open(std::uint64_t max_bytes = 1 << 20) {
    return ImageStore({.folder = folder_, .suffix = "field", .max_bytes = max_bytes, .warn = [this](const std::string& message) {
                         warnings_.push_back(message);
                       }});
  }
  [[nodiscard]] std::size_t num_files() const {
    return static_cast<std::size_t>(std::distance(std::filesystem::directory_iterator(folder_), std::filesystem::directory_iterator()));
  }
  void age(const std::filesystem::path& path, std::chrono::seconds by) const {
    std::filesystem::last_write_time(path, std::filesystem::last_write_time(path) - by);
  }
  void write(const std::filesystem::path& path, const std::string& bytes) const {
    std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
  }

  std::filesystem::path folder_;
  std::vector<std::string> warnings_;
};

}  // namespace earshot
