// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/curve_keys.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "tests/support/workers/worker_processes.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

class CurveKeysFile : public testing::Test {
 protected:
  void write(const std::string& text, mode_t mode = 0600) const {
    std::ofstream(file_) << text;
    ::chmod(file_.c_str(), mode);
  }
  template <class Read>
  [[nodiscard]] std::string refusal_of(Read&& read) const {
    try {
      read(file_);
    } catch (const InputError& error) {
      return error.what();
    }
    return "was taken";
  }

  PrivateTestFolder folder_;
  std::filesystem::path file_ = folder_.path() / "keys";
};

TEST_F(CurveKeysFile, IsWrittenForItsOwnerAloneAndReadBack) {
  ASSERT_TRUE(has_curve());
  const CurveKeys keys = make_curve_keys();
  EXPECT_TRUE(is_curve_key(keys.public_key) && is_curve_key(keys.secret_key));
  EXPECT_NE(keys.public_key, make_curve_keys().public_key);
  const mode_t mask = ::umask(0);
  write_curve_keys(file_, keys);
  ::umask(mask);
  struct stat status {};
  ASSERT_EQ(::stat(file_.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 07777, 0600u);
  const CurveKeys again = read_curve_keys(file_);
  EXPECT_EQ(again.public_key, keys.public_key);
  EXPECT_EQ(again.secret_key, keys.secret_key);
  EXPECT_THAT(refusal_of([&](const auto& file) { write_curve_keys(file, keys); }), HasSubstr("already exists"));
}

TEST_F(CurveKeysFile, IsRefusedIfOthersCanReadItOrItHoldsNoPair) {
  const CurveKeys keys = make_curve_keys(), other = make_curve_keys();
  const std::string good = "public " + keys.public_key + "\nsecret " + keys.secret_key + "\n";
  write(good);
  EXPECT_NO_THROW(read_curve_keys(file_));
  for (const mode_t mode : {0640u, 0604u, 0620u, 0610u, 0666u}) {
    write(good, mode);
    EXPECT_THAT(refusal_of(read_curve_keys), AllOf(HasSubstr("accessed by other users"), HasSubstr("chmod 600")));
  }
  const std::string texts[] = {"",
                               "public " + keys.public_key + "\n",
                               good + good,
                               good + "more\n",
                               "public " + other.public_key + "\nsecret " + keys.secret_key + "\n",
                               "public " + keys.public_key.substr(1) + "\nsecret " + keys.secret_key + "\n",
                               "public " + keys.public_key + "\nsecret " + std::string(40, ' ') + "\n"};
  for (const auto& text : texts) {
    write(text);
    const std::string refusal = refusal_of(read_curve_keys);
    EXPECT_THAT(refusal, AllOf(HasSubstr("earshot keys"), Not(HasSubstr(keys.secret_key)), Not(HasSubstr("\n")))) << text;
  }
  std::filesystem::remove(file_);
  EXPECT_THAT(refusal_of(read_curve_keys), HasSubstr("No such file"));
  std::filesystem::create_directory(file_);
  EXPECT_THAT(refusal_of(read_curve_keys), HasSubstr("is not a file"));
}

TEST_F(CurveKeysFile, AllowListTakesNotesAndRefusesWhatIsNoKey) {
  const std::string first_key = make_curve_keys().public_key, second_key = make_curve_keys().public_key;
  write("# hosts of the cluster\n\n" + first_key + " node1\n" + second_key + "\r\n#\n", 0644);
  EXPECT_THAT(read_allow_list(file_), testing::UnorderedElementsAre(first_key, second_key));
  write(first_key + "x\n");
  EXPECT_THAT(refusal_of(read_allow_list), HasSubstr("line 1 is not a public key"));
  write("# nothing\n");
  EXPECT_THAT(refusal_of(read_allow_list), HasSubstr("contains no key"));
  write(first_key, 0664);
  EXPECT_THAT(refusal_of(read_allow_list), HasSubstr("written by other users"));
}

}  // namespace
}  // namespace earshot
