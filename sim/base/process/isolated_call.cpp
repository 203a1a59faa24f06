// SPDX-License-Identifier: Apache-2.0
#include "sim/base/process/isolated_call.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
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
#include "sim/base/process/child_program.h"
#include "sim/base/process/companion_program.h"

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
  ChildProgram child({.program = program, .arguments = std::move(child_arguments), .descriptor = pipe.write.get()});
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
