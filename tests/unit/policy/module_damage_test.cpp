// SPDX-License-Identifier: Apache-2.0
// Fuzzes modules behind the checks of the archive: each is read and tried out in a process with the limits of a policy's.  clang 14, whose
// libFuzzer the other parsers have, does not compile the headers of libtorch.  EARSHOT_DAMAGED_MODULES: how many (default 200).
#include "tests/support/workers/module_damage.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <iostream>
#include <map>
#include <string>
#include <vector>

#include "policy/torch_threads.h"
#include "tests/support/files/mutate.h"

namespace earshot {
namespace {

TEST(ModuleDamage, EndsInARefusalOfOneLineOrAtALimit) {
  use_one_torch_thread();
  warm_up_script_modules();
  const std::vector<ModuleRecord> whole = records_of(*file_like(pointgoal_policy(4), kGruSource + kGruSequence));
  ASSERT_GE(whole.size(), 4U);
  const ModuleEnd undamaged = end_of_module(file_of(whole));
  // Needs a process without a backward pass, as ctest gives it: a fork leaves the threads of autograd behind.
  ASSERT_EQ(undamaged.kind, ModuleEnd::Kind::works) << undamaged.text;
  std::vector<std::size_t> parsed;
  for (std::size_t i = 0; i < whole.size(); ++i)
    if (whole[i].name.ends_with(".py") || whole[i].name.ends_with("data.pkl") || whole[i].name.ends_with("constants.pkl"))
      parsed.push_back(i);
  ASSERT_GE(parsed.size(), 2U);
  std::map<ModuleEnd::Kind, int> ends;
  const char* user_set = std::getenv("EARSHOT_DAMAGED_MODULES");
  const auto num_draws = static_cast<std::uint32_t>(user_set ? std::max(200, std::atoi(user_set)) : 200);
  for (std::uint32_t draw = 0; draw < num_draws; ++draw) {
    std::vector<ModuleRecord> records = whole;
    // Any record now and then, else one that libtorch parses: the others are mostly weights, whose damage is another weight.
    ModuleRecord& record = records[draw % 8 == 0 ? draw / 8 % records.size() : parsed[draw % parsed.size()]];
    record.bytes = mutated(record.bytes, draw);
    const ModuleEnd end = end_of_module(file_of(records));
    EXPECT_NE(end.kind, ModuleEnd::Kind::wrong) << "draw " << draw << ", " << record.name << ": " << end.text;
    ++ends[end.kind];
  }
  // Some damage meets weights and names that are not read.
  EXPECT_GT(ends[ModuleEnd::Kind::refused], num_draws / 4);
  std::cout << num_draws << " damaged modules: " << ends[ModuleEnd::Kind::refused] << " refused, " << ends[ModuleEnd::Kind::works]
            << " work, " << ends[ModuleEnd::Kind::stopped] << " end their process\n";
}

}  // namespace
}  // namespace earshot
