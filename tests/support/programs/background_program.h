// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "sim/base/files.h"
#include "tests/support/files/test_paths.h"
#include "tests/support/wait_until.h"

namespace earshot {

/// The program, running beside the test in a process group of its own, with its output and errors in a file.  Killed at the end.
class BackgroundProgram {
 public:
  /// arguments: words, or a whole shell command line where shell is true, in which $EARSHOT is the program.
  BackgroundProgram(const std::vector<std::string>& arguments, std::string output) : output_(std::move(output)) {
    std::vector<std::string> line{earshot_program().string()};
    line.insert(line.end(), arguments.begin(), arguments.end());
    start(line);
  }
  BackgroundProgram(const std::string& shell_command, std::string output) : output_(std::move(output)) {
    start({"/bin/sh", "-c", shell_command});
  }
  ~BackgroundProgram() {
    if (pid_ <= 0) return;
    ::kill(-pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
  }
  BackgroundProgram(const BackgroundProgram&) = delete;
  BackgroundProgram& operator=(const BackgroundProgram&) = delete;

  [[nodiscard]] pid_t pid() const { return pid_; }
  void signal(int number) const { ::kill(pid_, number); }
  void signal_all(int number) const { ::kill(-pid_, number); }
  /// Exit code, 128 + signal as a shell says it; -1 if it has not ended after so many seconds.
  int wait(double seconds = 120) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    while (pid_ > 0 && std::chrono::steady_clock::now() < end) {
      int status = 0;
      if (::waitpid(pid_, &status, WNOHANG) == pid_) {
        pid_ = 0;
        return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return -1;
  }
  [[nodiscard]] bool is_running() const { return pid_ > 0 && !has_ended(pid_); }
  [[nodiscard]] std::string text() const { return read_file(output_); }

  /// Waits until it has written this; false if that takes too long or it ends before.
  [[nodiscard]] bool has_written(const std::string& part, double seconds = 60) const {
    return wait_until([&] { return text().find(part) != std::string::npos; }, seconds, {&pid_, 1});
  }

  /// Waits until the file is there; false if that takes too long.
  static bool wait_for(const std::filesystem::path& file, double seconds = 60) {
    return wait_until([&] { return std::filesystem::exists(file); }, seconds);
  }

 private:
  void start(std::vector<std::string> line) {
    std::vector<char*> argv;
    for (std::string& word : line) argv.push_back(word.data());
    argv.push_back(nullptr);
    const int output = ::open(output_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
    pid_ = ::fork();
    if (pid_ == 0) {
      ::setpgid(0, 0);
      ::dup2(output, STDOUT_FILENO);
      ::dup2(output, STDERR_FILENO);
      ::execv(argv[0], argv.data());
      ::_exit(127);
    }
    ::setpgid(pid_, pid_);
    ::close(output);
  }

  std::string output_;
  pid_t pid_ = 0;
};

}  // namespace earshot
