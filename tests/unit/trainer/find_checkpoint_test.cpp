#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "tests/support/worker_processes.h"
#include "trainer/checkpoint.h"

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
  void damage(const std::string& name, const std::function<void(std::string&)>& how) {
    std::string bytes = read_file(path(name));
    how(bytes);
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

// Bits that flip, blocks that are zero, files that end early or are padded: each is seen, and the checkpoint before it is taken.
TEST_F(FindCheckpoint, AThousandRandomDamagesAreSeenAndThePreviousIsTaken) {
  write("update_000010.ckpt", 10);
  write("update_000020.ckpt", 20);
  const std::string whole = read_file(path("update_000020.ckpt"));
  const auto level = spdlog::get_level();
  spdlog::set_level(spdlog::level::off);  // a warning for each
  int harmless = 0;
  for (std::uint32_t trial = 0; trial < 1000; ++trial) {
    const RandomStream random(23, Purpose::test, trial);
    const auto below = [&](std::size_t bound, std::uint32_t draw) { return random.below(static_cast<std::uint32_t>(bound), draw); };
    std::string bytes = whole;
    switch (trial % 4) {
      case 0:
        for (std::uint32_t flip = 0; flip <= trial % 5; ++flip)
          bytes[below(bytes.size(), 2 * flip)] ^= static_cast<char>(1 << below(8, 2 * flip + 1));
        break;
      case 1:
        bytes.resize(below(bytes.size(), 0));
        break;
      case 2:
        std::fill_n(bytes.begin() + below(bytes.size() - 64, 0), 64, '\0');
        break;
      default:
        bytes.append(1 + below(4096, 0), '\0');
    }
    harmless += bytes == whole;
    write_file_atomically(path("update_000020.ckpt"), bytes);
    if (bytes != whole) {
      ASSERT_EQ(find_checkpoint(folder_.path()), path("update_000010.ckpt")) << trial;
    }
  }
  spdlog::set_level(level);
  EXPECT_LT(harmless, 10);  // two flips of one bit, or zeros where zeros were
}

TEST_F(FindCheckpoint, SaysWhyWhenNoneIsWhole) {
  EXPECT_NE(error().find("holds no checkpoint (*.ckpt)"), std::string::npos);
  write("last.ckpt", 1);
  damage("last.ckpt", [](std::string& bytes) { bytes[100] ^= 1; });
  EXPECT_NE(error().find("holds no checkpoint that is whole"), std::string::npos) << error();
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
