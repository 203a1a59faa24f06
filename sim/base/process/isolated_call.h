// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace earshot {

/// Some file formats are read by libraries that a damaged file can crash, or lead to write past their buffers, to loop, or to allocate
/// without bound.  Each of these libraries runs in its own process, a small program that reads one file, answers with bytes and ends.  A
/// failure there becomes an InputError here and cannot damage the memory of the run.
///
/// A program is started (posix_spawn) rather than this process copied (fork): in a process with threads a copy may find a lock held for
/// ever by a thread that it does not have, OpenBLAS ends its threads while others compute when a process is copied, and copying the page
/// tables of a run that holds 10 GB takes longer than starting a program that holds none.

struct IsolationLimits {
  /// For a driver, which maps memory of its device and keeps caches in files: neither is limited; the answer is, to 1 MB.
  static constexpr std::uint64_t kUnlimited = 0;
  std::chrono::milliseconds wall_time{60'000};
  std::uint64_t memory_bytes = std::uint64_t{4} << 30;  ///< that the program may take beyond what it starts with; bounds the answer too
  const char* worker = "the library that reads it";     ///< name of the library, for error messages
};

/// More for larger files: libraries were measured to take up to 12 times the size of a file, and to read 10 MB per second.
IsolationLimits limits_for_file(const std::filesystem::path& file);

/// Starts `program` with `arguments`, waits for its answer and for its end: no process and no descriptor stays behind.
/// where: the file that is read, named by errors.  Safe from any thread; Ctrl-C does not reach the program, which ends with this thread.
/// Throws InputError: what the program refuses; its crash; a limit reached; an answer cut short or damaged.  Throws RunError: cannot be
/// started. Costs about 6 ms to start, and 10 ms of CPU time per MB of the answer.
std::string call_isolated(const std::filesystem::path& program, const std::vector<std::string>& arguments, const std::string& where,
                          const IsolationLimits& limits = {});

/// The program that reads SOFA files: $EARSHOT_READER, or the companion program earshot_reader (companion_program.h).  Throws
/// RunError if it is nowhere.
std::filesystem::path reader_program();

/// The whole main() of such a program: sets the limits, then answers with what `work` returns for the arguments.  An InputError of
/// `work` is thrown again by call_isolated.
int answer_isolated(int argc, char** argv, const std::function<std::string(const std::vector<std::string>& arguments)>& work);

/// Message from the program by kAnswerDescriptor (child_program.h): 32 bytes (magic number, kind, length, XXH3 of the rest), then the
/// answer or the text of the refusal.
enum class AnswerKind : std::uint64_t { answer = 1, refusal = 2 };
std::string answer_header(AnswerKind kind, std::string_view bytes);
struct Answer {
  enum class State { cut_short, damaged, whole } state;
  AnswerKind kind{};
  std::string_view bytes{};  ///< inside the frame
};
/// cut_short: valid so far, with bytes missing at the end.
Answer decode_answer(std::string_view frame, std::uint64_t max_bytes);

}  // namespace earshot
