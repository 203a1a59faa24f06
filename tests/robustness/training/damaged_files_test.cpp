// SPDX-License-Identifier: Apache-2.0
// Files of a run that are damaged.  clang 14 cannot compile the headers of libtorch 1.13 as C++20, so the parsers beside it have no
// libFuzzer target; damage is made here instead, under the same rule: a value, or a refusal of one line.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "tests/support/files/mutate.h"
#include "tests/support/files/test_paths.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/run/run_config.h"

namespace earshot {
namespace {

template <class Read>
bool is_taken(std::uint32_t number, Read read) {
  try {
    read();
    return true;
  } catch (const InputError& error) {
    EXPECT_EQ(std::string_view(error.what()).find('\n'), std::string_view::npos) << error.what();
  } catch (const std::exception& error) {
    ADD_FAILURE() << "damage " << number << ": " << error.what();
  }
  return false;
}

Checkpoint small_checkpoint() {
  Checkpoint checkpoint;
  checkpoint.config_yaml = "name: x\nseed: 1\n";
  checkpoint.architecture = "depth 64x64";
  checkpoint.update = 12;
  checkpoint.env_steps = 1 << 20;
  checkpoint.weights = {{"actor.weight", torch::ones({4, 3})}, {"empty", torch::zeros({0, 7})}, {"flag", torch::ones({2}, torch::kBool)}};
  checkpoint.optimizer = {{"actor.weight.step", torch::tensor(5, torch::kInt64)}, {"actor.weight.exp_avg", torch::ones({4, 3})}};
  checkpoint.env_states = {"{}", ""};
  checkpoint.hidden = {torch::ones({2, 3})};
  checkpoint.not_done = {torch::ones({2})};
  return checkpoint;
}

// The body is damaged and the hash made right again: the hash finds accidents, and nothing may rest on it alone.
TEST(X_DamagedCheckpoint, IsWholeOrRefusedWhateverTheBodySays) {
  const std::filesystem::path path = std::filesystem::temp_directory_path() / fmt::format("earshot_damaged_{}.ckpt", ::getpid());
  save_checkpoint(small_checkpoint(), path);
  const std::string file = read_file(path);
  std::filesystem::remove(path);
  constexpr std::size_t header = 20, tail = 8;
  const std::string body = file.substr(header, file.size() - header - tail);
  int taken = 0, refused = 0;
  for (std::uint32_t number = 0; number < 20000; ++number) {
    const std::string damaged = mutated(body, number);
    std::string whole = file.substr(0, header) + damaged;
    const std::uint64_t length = damaged.size(), hash = hash64(damaged);
    std::memcpy(whole.data() + header - sizeof length, &length, sizeof length);
    whole.append(reinterpret_cast<const char*>(&hash), sizeof hash);
    const bool ok = is_taken(number, [&] {
      const Checkpoint read = decode_checkpoint(whole, "damaged.ckpt");
      for (const auto& [name, tensor] : read.weights) ASSERT_LE(tensor.nbytes(), whole.size());
    });
    ++(ok ? taken : refused);
  }
  EXPECT_GT(taken, 1000) << "damage inside numbers goes unseen without the hash";
  EXPECT_GT(refused, 1000);
}

TEST(X_DamagedCheckpoint, IsRefusedByItsHashAlone) {
  const std::filesystem::path path = std::filesystem::temp_directory_path() / fmt::format("earshot_damaged_{}.ckpt", ::getpid());
  save_checkpoint(small_checkpoint(), path);
  const std::string file = read_file(path);
  std::filesystem::remove(path);
  for (std::uint32_t number = 0; number < 5000; ++number) {
    const std::string damaged = mutated(file, number);
    const bool taken = is_taken(number, [&] { decode_checkpoint(damaged, "damaged.ckpt"); });
    EXPECT_EQ(taken, damaged == file) << number;
  }
}

TEST(X_DamagedTrainYaml, IsAConfigOrRefused) {
  for (const char* name : {"quick", "houses", "avnav"}) {
    const std::string text = read_file(source_dir() / "configs/train" / (std::string(name) + ".yaml"));
    ASSERT_TRUE(is_taken(0, [&] { parse_run_config(text, "run.yaml", {}); })) << name;
    int taken = 0;
    for (std::uint32_t number = 0; number < 1500; ++number)
      taken += is_taken(number, [&] { parse_run_config(mutated(text, number), "run.yaml", {}); }) ? 1 : 0;
    EXPECT_GT(taken, 50) << "damage in comments and names";
    EXPECT_LT(taken, 1450) << name;
  }
}

}  // namespace
}  // namespace earshot
