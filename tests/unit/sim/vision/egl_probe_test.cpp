// SPDX-License-Identifier: Apache-2.0
// Drivers that crash, hang, end their process or answer nonsense, played by a script in place of the reader program.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "sim/base/errors.h"
#include "sim/base/process/isolated_call.h"
#include "sim/vision/egl_context.h"
#include "sim/vision/egl_device.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::HasSubstr;

/// Takes the place of the reader program while it lives.  The script's $5 is the question; answers of the true reader come from `$READER
/// "$@"`.
class FakeReader {
 public:
  explicit FakeReader(const std::string& body) : before_(reader_program()), script_(folder_ / "reader") {
    std::ofstream(script_) << "#!/bin/bash\nREADER=" << before_.string() << "\n" << body << "\nexec $READER \"$@\"\n";
    std::filesystem::permissions(script_, std::filesystem::perms::owner_all);
    ::setenv("EARSHOT_READER", script_.c_str(), 1);
  }
  ~FakeReader() { ::unsetenv("EARSHOT_READER"); }
  FakeReader(const FakeReader&) = delete;
  FakeReader& operator=(const FakeReader&) = delete;

 private:
  TempFolder folder_;
  std::filesystem::path before_;
  std::string script_;
};

TEST(EglProbe, CrashOfEachDeviceIsItsProblem) {
  const std::vector<EglDevice> sound = list_egl_devices();
  const FakeReader reader(R"([ "$5" = count ] || kill -SEGV $$)");
  const std::vector<EglDevice> listed = list_egl_devices();
  const bool has_devices = !sound.empty() && !sound.front().surfaceless();
  ASSERT_EQ(listed.size(), has_devices ? sound.size() : 0U);
  for (const EglDevice& device : listed) {
    EXPECT_EQ(device.renderer, "");
    EXPECT_THAT(device.problem, HasSubstr("crashes its driver (signal 11"));
  }
  for (const char* device : {"software", "auto", "0"}) EXPECT_THROW(EglContext{device}, InputError) << device;
}

TEST(EglProbe, DriverThatEndsTheProcessIsAProblem) {
  const FakeReader reader(R"([ "$5" = count ] || exit 7)");
  EXPECT_THAT(probe_egl_device(EglDevice::kSurfaceless).problem, HasSubstr("makes its driver exit with code 7"));
}

TEST(EglProbe, ListThatCrashesNamesTheCrash) {
  const FakeReader reader("kill -ABRT $$");
  const std::vector<EglDevice> listed = list_egl_devices();
  ASSERT_EQ(listed.size(), 1U);
  EXPECT_EQ(listed[0].renderer, "");
  EXPECT_THAT(listed[0].problem, HasSubstr("crashes its driver (signal 6"));
}

TEST(EglProbe, OtherDevicesThanTheBrokenOneAreUsed) {
  const std::vector<EglDevice> sound = list_egl_devices();
  if (sound.empty() || sound[0].renderer.empty()) GTEST_SKIP() << "no EGL device renders here";
  // One more device than there are, the last of which crashes.
  const std::string last = std::to_string(sound.size());
  const FakeReader reader("if [ \"$5\" = " + last + " ]; then kill -SEGV $$; fi");
  EXPECT_EQ(list_egl_devices().size(), sound.size());
  const EglContext context(sound[0].software ? "software" : "auto");
  EXPECT_FALSE(context.renderer().empty());
}

TEST(EglProbe, UnknownQuestionsAreRefused) {
  for (const char* question : {"", "x", "-2", "1x", "99999999999999999999"})
    EXPECT_THROW(answer_egl_probe(question), InputError) << question;
}

}  // namespace
}  // namespace earshot
