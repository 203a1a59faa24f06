// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <exception>
#include <filesystem>
#include <string>
#include <vector>

namespace earshot {

/// A command line of earshot: its commands (commands.h), its help, and what the exit codes mean.
class Program {
 public:
  Program(int argc, char** argv);
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  CLI::App& app() { return app_; }
  /// All words behind the name of the program.
  [[nodiscard]] const std::vector<std::string>& arguments() const { return arguments_; }
  /// What `run` returns where a command neither throws nor sets it: 0.
  int& exit_code() { return exit_code_; }
  /// Whether the first word is one of the commands, or asks for the version.
  [[nodiscard]] bool has_requested_command() const;

  /// Parses the command line, which runs the command.  Returns the exit code (exit_codes.h); errors are one line on stderr.
  int run();

 private:
  int argc_;
  char** argv_;
  std::vector<std::string> arguments_;
  int exit_code_ = 0;
  CLI::App app_;
};

/// Goes on as another program with the same command line and the same process.  Throws RunError if it cannot be started.
[[noreturn]] void continue_as(const std::filesystem::path& program, char** argv);

/// One line of an error on stderr; returns the exit code.
int report_failure(const std::exception& error);

}  // namespace earshot
