// SPDX-License-Identifier: Apache-2.0
// Each line of `earshot doctor` follows what it checks: the tests take one thing away and look for the state, the remedy and the exit code.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "sim/rays/embree_options.h"
#include "tests/support/files/test_files.h"
#include "tests/support/files/test_paths.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::ContainsRegex;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

struct Report {
  int exit_code = -1;
  std::string text;  ///< standard output and error
  /// The line that is about `check`.
  [[nodiscard]] std::string line(const std::string& check) const {
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);)
      if (line.size() > 6 && line.substr(6).starts_with(check + " ")) return line;
    return {};
  }
};

/// variables: "NAME=VALUE ..." of its environment.
Report doctor(const std::string& variables) {
  Report report;
  FILE* output = ::popen(("env " + variables + " " + earshot::earshot_program().string() + " doctor 2>&1").c_str(), "r");
  if (output == nullptr) return report;
  for (int c = 0; (c = std::fgetc(output)) != EOF;) report.text += static_cast<char>(c);
  const int status = ::pclose(output);
  report.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return report;
}

TEST(Doctor, HasALineForEveryPart) {
  const Report report = doctor("");
  EXPECT_EQ(report.exit_code, 0) << report.text;
  for (const char* part : {"earshot", "CPU", "vectors", "Embree", "EGL", "reader", "BLAS", "libtorch", "test data"})
    EXPECT_THAT(report.line(part), ContainsRegex("^(ok|SLOW|none) ")) << part << " in:\n" << report.text;
  EXPECT_THAT(report.line("reader"), StartsWith("ok "));
}

TEST(Doctor, BlasNamesItsKernelsAndIsSlowWithThoseOfAnOldProcessor) {
  if (doctor("").line("BLAS").find("openblas") == std::string::npos) GTEST_SKIP() << "another BLAS than OpenBLAS";
  for (const char* kernel : {"Haswell", "Prescott"}) {
    const Report report = doctor(std::string("OPENBLAS_CORETYPE=") + kernel);
    EXPECT_EQ(report.exit_code, 0) << report.text;
    EXPECT_THAT(report.line("BLAS"), HasSubstr(std::string("kernels for ") + kernel)) << report.text;
    // Where the processor has AVX2, only the kernels without it are slow.
    const bool slow = kernel == std::string("Prescott") && report.line("vectors").find("AVX2") != std::string::npos;
    EXPECT_THAT(report.line("BLAS"), StartsWith(slow ? "SLOW " : "ok ")) << report.text;
    if (slow) {
      EXPECT_THAT(report.line("BLAS"), HasSubstr("set OPENBLAS_CORETYPE=Haswell"));
    }
  }
}

TEST(Doctor, EmbreeNamesItsInstructionSetAndRefusesAnUnknownOne) {
  for (const RayIsa& isa : ray_isas()) {
    const Report report = doctor("EARSHOT_ISA=" + isa.name);
    EXPECT_EQ(report.exit_code, isa.present ? 0 : 1) << report.text;
    EXPECT_THAT(report.line("Embree"),
                isa.present ? HasSubstr(" " + isa.name + " instructions") : HasSubstr("does not support this instruction set"))
        << report.text;
  }
  const Report report = doctor("EARSHOT_ISA=avx22");
  EXPECT_EQ(report.exit_code, 1) << report.text;
  EXPECT_THAT(report.line("Embree"), AllOf(StartsWith("BAD "), HasSubstr("did you mean 'avx2'?")));
}

TEST(Doctor, ReaderThatIsNotThereOrDoesNotAnswerIsBad) {
  for (const char* program : {"/nonexistent/earshot_reader", "/bin/true"}) {
    const Report report = doctor(std::string("EARSHOT_READER=") + program);
    EXPECT_EQ(report.exit_code, 1) << program;
    EXPECT_THAT(report.line("reader"), AllOf(StartsWith("BAD "), HasSubstr("build or install earshot_reader"))) << report.text;
  }
}

TEST(Doctor, DriverThatCrashesIsALineAndNoCrash) {
  const TempFolder folder;
  const std::string reader = folder / "reader";
  std::ofstream(reader) << "#!/bin/bash\n[ \"$4\" != egl ] || kill -SEGV $$\nexec "
                        << (earshot_program().parent_path() / "earshot_reader").string() << " \"$@\"\n";
  std::filesystem::permissions(reader, std::filesystem::perms::owner_all);
  const Report report = doctor("EARSHOT_READER=" + reader);
  EXPECT_EQ(report.exit_code, 0) << report.text;
  EXPECT_THAT(report.line("EGL"), AllOf(StartsWith("none "), HasSubstr("crashes its driver (signal 11")));
  EXPECT_THAT(report.line("reader"), StartsWith("ok "));
}

TEST(Doctor, TestDataThatAreAbsentAreSaidToBeAndAreNoFault) {
  const Report report = doctor("EARSHOT_DATA=/nonexistent");
  EXPECT_EQ(report.exit_code, 0) << report.text;
  EXPECT_THAT(report.line("test data"),
              AllOf(StartsWith("none "), HasSubstr("no test data"), HasSubstr("skipped"), HasSubstr("only tests need it")));
}

TEST(Doctor, NamesTheTestDataThatAreThere) {
  const TempFolder folder;
  for (const char* part : {"scenes", "audio"}) std::filesystem::create_directories(folder / part);
  Report report = doctor("EARSHOT_DATA=" + (folder / ""));
  EXPECT_THAT(report.line("test data"), AllOf(StartsWith("none "), HasSubstr("only audio, scenes"), HasSubstr("hrtf, materials, rir")));
  for (const char* part : {"hrtf", "materials", "rir"}) std::filesystem::create_directories(folder / part);
  report = doctor("EARSHOT_DATA=" + (folder / ""));
  EXPECT_THAT(report.line("test data"), AllOf(StartsWith("ok "), Not(HasSubstr("skipped"))));
}

TEST(Doctor, VersionIsThatOfTheProject) {
  const Report report = doctor("");
  EXPECT_THAT(report.line("earshot"), HasSubstr(EARSHOT_VERSION));
}

}  // namespace
}  // namespace earshot
