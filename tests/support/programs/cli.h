// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "tests/support/files/test_paths.h"

namespace earshot {

struct CliOutcome {
  int exit_code = -1;
  std::string output, errors;
};

/// Runs the program as a user does, in a folder of the test's own.
class Cli : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() /
              ("earshot_cli_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()) + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  [[nodiscard]] std::string file(const std::string& name) const { return (folder_ / name).string(); }
  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(file(name), std::ios::binary) << text;
    return file(name);
  }
  [[nodiscard]] std::string read(const std::string& name) const {
    std::ifstream stream(file(name), std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
  }
  [[nodiscard]] CliOutcome earshot(const std::string& arguments) const { return run(earshot_program().string() + " " + arguments); }
  [[nodiscard]] CliOutcome run(const std::string& line) const {
    const int status = std::system((line + " >" + file("stdout") + " 2>" + file("stderr")).c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read("stdout"), read("stderr")};
  }
  /// Samples of a 32-bit float WAV, channels interleaved: what follows the head of the data chunk.
  [[nodiscard]] std::vector<float> read_wav(const std::string& name) const {
    const std::string bytes = read(name);
    const std::size_t data = bytes.find("data");
    EXPECT_NE(data, std::string::npos) << name;
    if (data == std::string::npos) return {};
    std::uint32_t size = 0;
    std::memcpy(&size, bytes.data() + data + 4, 4);
    std::vector<float> samples(size / sizeof(float));
    std::memcpy(samples.data(), bytes.data() + data + 8, samples.size() * sizeof(float));
    return samples;
  }
  /// Exit code 2 and one line on stderr that holds `text`; no output file exists.
  void expect_bad_input(const std::string& arguments, const std::string& text) const {
    const CliOutcome outcome = earshot(arguments);
    EXPECT_EQ(outcome.exit_code, 2) << arguments << "\n" << outcome.errors;
    EXPECT_THAT(outcome.errors, testing::HasSubstr(text)) << arguments;
    EXPECT_EQ(std::count(outcome.errors.begin(), outcome.errors.end(), '\n'), 1) << outcome.errors;
  }

  std::filesystem::path folder_;
};

}  // namespace earshot
