// SPDX-License-Identifier: Apache-2.0
#include "sim/base/process/isolated_call.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <optional>
#include <system_error>
#include <utility>

#include "sim/base/errors.h"
#include "sim/base/file_descriptor.h"
#include "sim/base/files.h"
#include "sim/base/process/companion_program.h"

extern char** environ;

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::uint64_t kMagic = 0x31534E4152414545;  // "EEARANS1" in little-endian order
constexpr std::size_t kHeaderBytes = 4 * sizeof(std::uint64_t);
constexpr int kPipeBytes = 1 << 20;
constexpr const char* kDriverRemedy = "update or remove the driver";
constexpr const char* kRemedy = "check the file in another program, or export or download it again";

std::string message_of(int error) { return std::generic_category().message(error); }

struct Pipe {
  Descriptor read, write;
};

/// Both ends close themselves in programs that other threads start meanwhile; the end to write to lies above 0 to 3, which the program
/// gets anew.
Pipe open_pipe() {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0) throw RunError("pipe", "cannot be opened: " + message_of(errno));
  Pipe pipe{Descriptor(ends[0]), Descriptor(ends[1])};
  pipe.write = Descriptor(::fcntl(ends[1], F_DUPFD_CLOEXEC, kAnswerDescriptor + 1));
  if (pipe.write.get() < 0) throw RunError("pipe", "cannot be opened: " + message_of(errno));
  static_cast<void>(::fcntl(pipe.read.get(), F_SETPIPE_SZ, kPipeBytes));  // fewer turns; a smaller pipe works too
  return pipe;
}

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

/// A program that runs, ended and waited for at the latest here.
class Child {
 public:
  Child(const std::filesystem::path& program, const std::vector<std::string>& arguments, int answer_end) {
    SpawnActions spawn;
    // Output of libraries is dropped: the answer states the error in one line.
    posix_spawn_file_actions_addopen(&spawn.actions, 0, "/dev/null", O_RDONLY, 0);
    for (const int output : {1, 2}) posix_spawn_file_actions_addopen(&spawn.actions, output, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_adddup2(&spawn.actions, answer_end, kAnswerDescriptor);
    sigset_t all_signals, no_signals;
    sigfillset(&all_signals);
    sigemptyset(&no_signals);
    posix_spawnattr_setsigdefault(&spawn.attributes, &all_signals);
    posix_spawnattr_setsigmask(&spawn.attributes, &no_signals);
    posix_spawnattr_setpgroup(&spawn.attributes, 0);  // a group of its own: Ctrl-C goes to this process only
    posix_spawnattr_setflags(&spawn.attributes, static_cast<short>(POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETPGROUP));
    std::vector<char*> pointers{const_cast<char*>(program.c_str())};  // as execve is declared; never written to
    for (const std::string& argument : arguments) pointers.push_back(const_cast<char*>(argument.c_str()));
    pointers.push_back(nullptr);
    const int error = ::posix_spawn(&pid_, program.c_str(), &spawn.actions, &spawn.attributes, pointers.data(), environ);
    if (error != 0) throw RunError(program.string(), "cannot be started: " + message_of(error));
  }
  ~Child() { end(); }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  /// Ends it if it has not ended; its status as waitpid gives it, nullopt if another waitpid took that.
  std::optional<int> end() {
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

 private:
  pid_t pid_ = -1;
  std::optional<int> status_;
};

/// Reads until the answer is whole or damaged, the other end is closed, or the time is up.  False: the time is up.
bool read_answer(int descriptor, Clock::time_point deadline, std::uint64_t max_bytes, std::string& frame) {
  constexpr std::size_t block = std::size_t{1} << 20;
  std::size_t filled = 0;
  const auto leave = [&](bool in_time) {
    frame.resize(filled);
    return in_time;
  };
  for (;;) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now()).count();
    if (left <= 0) return leave(false);
    pollfd waited{descriptor, POLLIN, 0};
    const int ready = ::poll(&waited, 1, static_cast<int>(std::min<long>(left, 1000)));
    if (ready < 0 && errno != EINTR) throw RunError("pipe", "cannot be waited for: " + message_of(errno));
    if (ready <= 0) continue;
    if (frame.size() < filled + block) frame.resize(std::max(filled + block, 2 * filled));
    const ssize_t count = ::read(descriptor, frame.data() + filled, frame.size() - filled);
    if (count < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (count <= 0) return leave(true);
    const std::size_t before = std::exchange(filled, filled + static_cast<std::size_t>(count));
    // The hash is taken once, at the end: until then only the header is checked.
    if (before < kHeaderBytes && filled >= kHeaderBytes &&
        decode_answer(std::string_view(frame).substr(0, kHeaderBytes), max_bytes).state == Answer::State::damaged)
      return leave(true);
    if (filled >= kHeaderBytes) {
      std::uint64_t length = 0;
      std::memcpy(&length, frame.data() + 2 * sizeof length, sizeof length);
      if (filled - kHeaderBytes >= length) return leave(true);
    }
  }
}

std::string manner_of(std::optional<int> status, const char* worker) {
  if (status && WIFSIGNALED(*status)) {
    const int signal = WTERMSIG(*status);
    if (signal == SIGXCPU) return "takes too long to read";
    if (signal != SIGKILL) return fmt::format("crashes {} (signal {}, {})", worker, signal, ::strsignal(signal));
  }
  if (status && WIFEXITED(*status) && WEXITSTATUS(*status) != 0)
    return fmt::format("makes {} exit with code {}", worker, WEXITSTATUS(*status));
  return fmt::format("gets an incomplete answer from {}", worker);
}

}  // namespace

IsolationLimits limits_for_file(const std::filesystem::path& file) {
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(file, error);
  const std::uint64_t bytes = error ? 0 : std::min<std::uint64_t>(size, std::uint64_t{1} << 40);
  return {.wall_time = std::chrono::milliseconds(30'000 + bytes / 500), .memory_bytes = (std::uint64_t{1} << 30) + 40 * bytes};
}

std::string call_isolated(const std::filesystem::path& program, const std::vector<std::string>& arguments, const std::string& where,
                          const IsolationLimits& limits) {
  const Clock::time_point deadline = Clock::now() + limits.wall_time;
  const std::int64_t seconds = std::chrono::ceil<std::chrono::seconds>(limits.wall_time).count() + 1;
  std::vector<std::string> child_arguments{std::to_string(::getpid()), std::to_string(limits.memory_bytes), std::to_string(seconds)};
  child_arguments.insert(child_arguments.end(), arguments.begin(), arguments.end());

  Pipe pipe = open_pipe();
  Child child(program, child_arguments, pipe.write.get());
  pipe.write = Descriptor();  // so that the end of the program is the end of the pipe
  std::string frame;
  const bool is_driver = limits.memory_bytes == IsolationLimits::kUnlimited;
  const std::uint64_t max_bytes = is_driver ? std::uint64_t{1} << 20 : limits.memory_bytes;
  const char* remedy = is_driver ? kDriverRemedy : kRemedy;
  const bool in_time = read_answer(pipe.read.get(), deadline, max_bytes, frame);
  const std::optional<int> status = child.end();
  // The exit code of a shell, the dynamic loader, or posix_spawn under an emulator when a program cannot start.
  if (frame.empty() && status && WIFEXITED(*status) && WEXITSTATUS(*status) == 127)
    throw RunError(program.string(), "cannot be started: the program or one of its libraries is missing (exit code 127)");
  const Answer answer = decode_answer(frame, max_bytes);
  if (answer.state == Answer::State::whole && answer.kind == AnswerKind::answer) {
    frame.erase(0, frame.size() - answer.bytes.size());
    return frame;
  }
  if (answer.state == Answer::State::whole) {
    // The message of the program begins with the same name of the file.
    std::string_view text = answer.bytes;
    if (text.starts_with(where + ": ")) text.remove_prefix(where.size() + 2);
    throw InputError(where, text, "");
  }
  if (!in_time)
    throw InputError(where,
                     fmt::format("{} within {} s", is_driver ? "did not answer" : "was not read",
                                 std::chrono::duration<double>(limits.wall_time).count()),
                     remedy);
  throw InputError(where, manner_of(status, limits.worker), remedy);
}

std::filesystem::path reader_program() { return companion_program("earshot_reader", "EARSHOT_READER"); }

std::string answer_header(AnswerKind kind, std::string_view bytes) {
  const std::array<std::uint64_t, 4> header{kMagic, static_cast<std::uint64_t>(kind), bytes.size(), hash64(bytes)};
  return {reinterpret_cast<const char*>(header.data()), kHeaderBytes};
}

Answer decode_answer(std::string_view frame, std::uint64_t max_bytes) {
  if (frame.size() < kHeaderBytes) return {Answer::State::cut_short};
  std::array<std::uint64_t, 4> header{};
  std::memcpy(header.data(), frame.data(), kHeaderBytes);
  const auto [magic, kind, length, hash] = header;
  const bool known = kind == static_cast<std::uint64_t>(AnswerKind::answer) || kind == static_cast<std::uint64_t>(AnswerKind::refusal);
  if (magic != kMagic || !known || length > max_bytes) return {Answer::State::damaged};
  const std::string_view bytes = frame.substr(kHeaderBytes);
  if (bytes.size() < length) return {Answer::State::cut_short};
  if (bytes.size() > length || hash64(bytes) != hash) return {Answer::State::damaged};
  return {Answer::State::whole, static_cast<AnswerKind>(kind), bytes};
}

}  // namespace earshot
