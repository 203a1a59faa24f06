// SPDX-License-Identifier: Apache-2.0
#include "sim/base/process/child_program.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <csignal>
#include <new>
#include <string_view>
#include <system_error>
#include <thread>

#include "sim/base/errors.h"

extern char** environ;

namespace earshot {
namespace {

struct SpawnActions {
  SpawnActions() {
    if (posix_spawn_file_actions_init(&actions) != 0) throw std::bad_alloc();
    if (posix_spawnattr_init(&attributes) != 0) throw std::bad_alloc();
  }
  ~SpawnActions() {
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&actions);
  }
  SpawnActions(const SpawnActions&) = delete;
  SpawnActions& operator=(const SpawnActions&) = delete;
  posix_spawn_file_actions_t actions{};
  posix_spawnattr_t attributes{};
};

/// Variables of this process that the program gets, then those of the setup; pointers into both.
std::vector<char*> environment_of(const ChildSetup& setup) {
  std::vector<char*> all;
  for (char** variable = environ; *variable != nullptr; ++variable) {
    const std::string_view text = *variable, name = text.substr(0, text.find('=') + 1);
    const auto begins_with_name = [&](const std::string& other) { return other.starts_with(name); };
    const bool is_passed = setup.passed.empty() || std::ranges::find(setup.passed, text.substr(0, text.find('='))) != setup.passed.end();
    if (is_passed && std::ranges::none_of(setup.variables, begins_with_name)) all.push_back(*variable);
  }
  for (const std::string& variable : setup.variables) all.push_back(const_cast<char*>(variable.c_str()));  // as execve is declared
  all.push_back(nullptr);
  return all;
}

}  // namespace

ChildProgram::ChildProgram(const ChildSetup& setup) {
  SpawnActions spawn;
  if (!setup.folder.empty()) posix_spawn_file_actions_addchdir_np(&spawn.actions, setup.folder.c_str());
  // Output of libraries is dropped: the answer states the error in one line.
  posix_spawn_file_actions_addopen(&spawn.actions, 0, "/dev/null", O_RDONLY, 0);
  for (const int output : {1, 2}) posix_spawn_file_actions_addopen(&spawn.actions, output, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_adddup2(&spawn.actions, setup.descriptor, kAnswerDescriptor);
  posix_spawn_file_actions_addclosefrom_np(&spawn.actions, kAnswerDescriptor + 1);
  sigset_t all_signals, no_signals;
  sigfillset(&all_signals);
  sigemptyset(&no_signals);
  posix_spawnattr_setsigdefault(&spawn.attributes, &all_signals);
  posix_spawnattr_setsigmask(&spawn.attributes, &no_signals);
  posix_spawnattr_setpgroup(&spawn.attributes, 0);
  posix_spawnattr_setflags(&spawn.attributes, static_cast<short>(POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETPGROUP));
  std::vector<char*> pointers{const_cast<char*>(setup.program.c_str())};  // as execve is declared; never written to
  for (const std::string& argument : setup.arguments) pointers.push_back(const_cast<char*>(argument.c_str()));
  pointers.push_back(nullptr);
  const std::vector<char*> environment = environment_of(setup);
  const int error = ::posix_spawn(&pid_, setup.program.c_str(), &spawn.actions, &spawn.attributes, pointers.data(), environment.data());
  if (error != 0) {
    pid_ = -1;
    throw RunError(setup.program.string(), "cannot be started: " + std::generic_category().message(error));
  }
}

std::optional<int> ChildProgram::end(std::chrono::milliseconds patience) {
  if (pid_ < 0) return status_;
  siginfo_t info{};
  const auto has_ended = [&] {
    return ::waitid(P_PID, static_cast<id_t>(pid_), &info, WEXITED | WNOHANG | WNOWAIT) != 0 || info.si_pid == pid_;
  };
  for (const auto until = std::chrono::steady_clock::now() + patience; !has_ended() && std::chrono::steady_clock::now() < until;)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  // The whole group: what the program has started ends too.  Without effect on the status of one that has ended.
  ::kill(-pid_, SIGKILL);
  int status = 0;
  pid_t waited = 0;
  while ((waited = ::waitpid(pid_, &status, 0)) < 0 && errno == EINTR) {
  }
  if (waited == pid_) status_ = status;
  pid_ = -1;
  return status_;
}

std::uint64_t number_argument(std::string_view digits) {
  std::uint64_t number = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), number);
  if (error != std::errc() || end != digits.data() + digits.size()) throw InputError(std::string(digits), "is not a number", "");
  return number;
}

}  // namespace earshot
