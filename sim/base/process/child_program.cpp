// SPDX-License-Identifier: Apache-2.0
#include "sim/base/process/child_program.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <new>
#include <string_view>
#include <system_error>

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

/// This process's variables, and those that take the place of some; pointers into both.
std::vector<char*> environment_with(const std::vector<std::string>& variables) {
  std::vector<char*> all;
  for (char** variable = environ; *variable != nullptr; ++variable) {
    const std::string_view name(*variable, std::string_view(*variable).find('=') + 1);
    bool is_replaced = false;
    for (const std::string& other : variables) is_replaced = is_replaced || other.starts_with(name);
    if (!is_replaced) all.push_back(*variable);
  }
  for (const std::string& variable : variables) all.push_back(const_cast<char*>(variable.c_str()));  // as execve is declared
  all.push_back(nullptr);
  return all;
}

}  // namespace

ChildProgram::ChildProgram(const ChildSetup& setup) {
  SpawnActions spawn;
  if (!setup.folder.empty()) posix_spawn_file_actions_addchdir_np(&spawn.actions, setup.folder.c_str());
  // What libraries print is dropped: the answer says in one line what is wrong.
  posix_spawn_file_actions_addopen(&spawn.actions, 0, "/dev/null", O_RDONLY, 0);
  for (const int output : {1, 2}) posix_spawn_file_actions_addopen(&spawn.actions, output, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_adddup2(&spawn.actions, setup.descriptor, kAnswerDescriptor);
  sigset_t all, none;
  sigfillset(&all);
  sigemptyset(&none);
  posix_spawnattr_setsigdefault(&spawn.attributes, &all);
  posix_spawnattr_setsigmask(&spawn.attributes, &none);
  posix_spawnattr_setpgroup(&spawn.attributes, 0);
  posix_spawnattr_setflags(&spawn.attributes, static_cast<short>(POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETPGROUP));
  std::vector<char*> pointers{const_cast<char*>(setup.program.c_str())};  // as execve is declared; never written to
  for (const std::string& argument : setup.arguments) pointers.push_back(const_cast<char*>(argument.c_str()));
  pointers.push_back(nullptr);
  const std::vector<char*> environment = environment_with(setup.variables);
  const int error = ::posix_spawn(&pid_, setup.program.c_str(), &spawn.actions, &spawn.attributes, pointers.data(), environment.data());
  if (error != 0) {
    pid_ = -1;
    throw RunError(setup.program.string(), "cannot be started: " + std::generic_category().message(error));
  }
}

std::optional<int> ChildProgram::end() {
  if (pid_ < 0) return status_;
  ::kill(pid_, SIGKILL);  // without effect on the status of one that has ended
  int status = 0;
  pid_t waited = 0;
  while ((waited = ::waitpid(pid_, &status, 0)) < 0 && errno == EINTR) {
  }
  if (waited == pid_) status_ = status;
  pid_ = -1;
  return status_;
}

}  // namespace earshot
