// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <fstream>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "tests/support/workers/worker_processes.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/run/policy_file.h"

namespace earshot {
namespace {

class FindCheckpoint : public testing::Test {
 protected:
  void write(const std::string& name, std::uint64_t update) {
    Checkpoint checkpoint;
    checkpoint.update = update;
    checkpoint.weights["w"] = torch::ones({100});
    save_checkpoint(checkpoint, path(name));
  }
  void damage(const std::string& name, const std::function<void(std::string&)>& change) {
    std::string bytes = read_file(path(name));
    change(bytes);
    write_file_atomically(path(name), bytes);
  }
  [[nodiscard]] std::filesystem::path path(const std::string& name) const { return folder_.path() / "checkpoints" / name; }
  std::string error() {
    try {
      find_checkpoint(folder_.path());
    } catch (const InputError& input_error) {
      return input_error.what();
    }
    return "found";
  }
  PrivateTestFolder folder_;
};

TEST_F(FindCheckpoint, TakesTheNewestThatIsWhole) {
  write("update_000010.ckpt", 10);
  write("update_000020.ckpt", 20);
  write("update_000030.ckpt", 30);
  EXPECT_EQ(find_checkpoint(folder_.path()), path("update_000030.ckpt"));
  damage("update_000030.ckpt", [](std::string& bytes) { bytes.resize(bytes.size() / 2); });  // the machine went down
  EXPECT_EQ(find_checkpoint(folder_.path()), path("update_000020.ckpt"));
  damage("update_000020.ckpt", [](std::string& bytes) { bytes[bytes.size() / 2] ^= 4; });  // a bit rotted
  EXPECT_EQ(find_checkpoint(folder_.path()), path("update_000010.ckpt"));
}

/// A damaged copy that differs: bits flipped, the end cut off, a block of zeros, two blocks swapped, a wrong length in the header, or bytes
/// after the end.  `part` of `parts`: damage of one place is made there, so that a thousand of them cover the whole file.
std::string damaged(const std::string& whole, std::uint32_t part, std::uint32_t parts) {
  for (std::uint32_t attempt = 0;; ++attempt) {  // zeros over zeros, or equal blocks, are not damage
    const RandomStream random(23, Purpose::test, part, attempt);
    std::uint32_t draw = 0;
    const auto below = [&](std::size_t bound) { return static_cast<std::size_t>(random.below(static_cast<std::uint32_t>(bound), draw++)); };
    const std::size_t place = (whole.size() * part + below(whole.size())) / parts;
    std::string bytes = whole;
    switch (part % 6) {
      case 0:
        bytes[place] = static_cast<char>(bytes[place] ^ (1 << below(8)));
        for (std::size_t remaining = below(5); remaining > 0; --remaining) bytes[below(bytes.size())] ^= static_cast<char>(1 << below(8));
        break;
      case 1:
        bytes.resize(place);
        break;
      case 2: {
        const std::size_t length = std::min(1 + below(4096), bytes.size() - place);
        std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(place), length, '\0');
        break;
      }
      case 3: {
        const std::size_t length = 1 + below(std::min<std::size_t>(4096, bytes.size() / 8)), first = below(bytes.size() - 2 * length);
        const std::size_t second = first + length + below(bytes.size() - first - 2 * length);
        const auto at = [&](std::size_t i) { return bytes.begin() + static_cast<std::ptrdiff_t>(i); };
        std::swap_ranges(at(first), at(first + length), at(second));
        break;
      }
      case 4:
        bytes[12 + below(8)] ^= static_cast<char>(1 + below(255));  // of the length
        break;
      default:
        bytes.append(1 + below(4096), static_cast<char>(below(256)));
    }
    if (bytes != whole) return bytes;
  }
}

/// As a run writes it, in small: 40 KB.
Checkpoint of_a_run(std::uint64_t update) {
  Checkpoint checkpoint;
  checkpoint.config_yaml = "name: test\n";
  checkpoint.update = update;
  torch::manual_seed(static_cast<std::int64_t>(update));
  for (const char* name : {"gru.weight", "actor.weight"}) {
    checkpoint.weights[name] = torch::randn({1, 1000});
    checkpoint.optimizer[std::string(name) + ".exp_avg"] = torch::randn({1, 1000});
    checkpoint.optimizer[std::string(name) + ".exp_avg_sq"] = torch::zeros({1, 1000});
  }
  checkpoint.env_states = {std::string(8000, 'e'), std::string(8000, 'f')};
  checkpoint.hidden = checkpoint.not_done = {torch::ones({2, 8}), torch::zeros({2, 8})};
  return checkpoint;
}

// Each of a thousand damages all over the file is detected, and the checkpoint before it is found and loads to its bits.
TEST_F(FindCheckpoint, AThousandRandomDamagesAreSeenAndThePreviousIsTaken) {
  const Checkpoint previous = of_a_run(10);
  save_checkpoint(previous, path("update_000010.ckpt"));
  save_checkpoint(of_a_run(20), path("update_000020.ckpt"));
  const std::string whole = read_file(path("update_000020.ckpt"));
  ASSERT_EQ(find_checkpoint(folder_.path()), path("update_000020.ckpt"));
  const auto level = spdlog::get_level();
  spdlog::set_level(spdlog::level::off);  // a warning for each
  constexpr std::uint32_t count = 1000;
  for (std::uint32_t part = 0; part < count; ++part) {
    std::ofstream(path("update_000020.ckpt"), std::ios::binary) << damaged(whole, part, count);
    ASSERT_THROW(load_checkpoint(path("update_000020.ckpt")), InputError) << part;
    const std::filesystem::path found = find_checkpoint(folder_.path());
    ASSERT_EQ(found, path("update_000010.ckpt")) << part;
    const Checkpoint loaded = load_checkpoint(found);
    ASSERT_EQ(hash_of(loaded.weights), hash_of(previous.weights));
    ASSERT_EQ(hash_of(loaded.optimizer), hash_of(previous.optimizer));
    ASSERT_EQ(loaded.env_states, previous.env_states);
  }
  spdlog::set_level(level);
}

TEST_F(FindCheckpoint, AThousandDamagedPolicyFilesAreRefused) {
  for (const WeightStorage storage : {WeightStorage::float32, WeightStorage::float16}) {
    save_checkpoint(policy_of(of_a_run(10), storage), path("a.policy"));
    const std::string whole = read_file(path("a.policy"));
    ASSERT_NO_THROW(decode_checkpoint(whole, "a.policy"));
    for (std::uint32_t part = 0; part < 1000; ++part) ASSERT_THROW(decode_checkpoint(damaged(whole, part, 1000), "a.policy"), InputError);
  }
}

TEST_F(FindCheckpoint, SaysWhyWhenNoneIsWhole) {
  EXPECT_NE(error().find("contains no checkpoint (*.ckpt)"), std::string::npos);
  write("last.ckpt", 1);
  damage("last.ckpt", [](std::string& bytes) { bytes[100] ^= 1; });
  EXPECT_NE(error().find("contains only damaged checkpoints"), std::string::npos) << error();
  EXPECT_NE(error().find("hash does not match"), std::string::npos) << error();
}

TEST_F(FindCheckpoint, AFileThatIsNamedIsTakenAtItsWord) {
  write("last.ckpt", 1);
  damage("last.ckpt", [](std::string& bytes) { bytes.pop_back(); });
  EXPECT_EQ(find_checkpoint(path("last.ckpt")), path("last.ckpt"));
  EXPECT_THROW(load_checkpoint(path("last.ckpt")), InputError);
}

}  // namespace
}  // namespace earshot
