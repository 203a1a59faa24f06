// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "sim/base/text/json.h"
#include "tests/support/files/test_paths.h"

namespace earshot {

/// Runs the benchmarks as a script does.
class BenchCli : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() /
              ("earshot_bench_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()) + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  [[nodiscard]] std::string file(const std::string& name) const { return (folder_ / name).string(); }
  [[nodiscard]] std::string read(const std::string& name) const {
    std::ifstream stream(file(name), std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
  }
  [[nodiscard]] int earshot(const std::string& arguments) const {
    const std::string command = earshot::earshot_program().string() + " " + arguments + " >" + file("stdout") + " 2>" + file("stderr");
    const int status = std::system(command.c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  /// Checks the contents that docs/reference/json_output.md, section 5 documents, and returns the names in it.
  [[nodiscard]] std::set<std::string> names_in(const std::string& name, const std::string& bench) const {
    const nlohmann::json report = parse_json(read(name));
    EXPECT_EQ(report.at("bench"), bench);
    EXPECT_TRUE(report.at("machine").at("cpu").is_string());
    EXPECT_GE(report.at("machine").at("cores"), 1);
    EXPECT_TRUE(report.at("commit").is_string());
    std::set<std::string> names;
    for (const nlohmann::json& result : report.at("results")) {
      names.insert(result.at("name").get<std::string>());
      EXPECT_TRUE(result.at("unit").is_string()) << result;
      EXPECT_TRUE(result.at("setting").is_object()) << result;
      if (result.at("value").is_null()) continue;
      EXPECT_LE(result.at("min"), result.at("value")) << result;
      EXPECT_GE(result.at("max"), result.at("value")) << result;
    }
    return names;
  }

  std::filesystem::path folder_;
};

}  // namespace earshot
