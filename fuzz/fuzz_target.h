// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <string_view>

#include "sim/base/errors.h"

/// One libFuzzer program per parser: its input is arbitrary bytes.  A parser may return a value or throw InputError with a message
/// of one line.  Everything else is a finding: another exception, a crash, a report of a sanitizer, 10 s without an answer, 2 GB of memory.
/// scripts/fuzz.sh runs all of them.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace earshot::fuzz {

inline std::string_view text_of(const std::uint8_t* data, std::size_t size) { return {reinterpret_cast<const char*>(data), size}; }

[[noreturn]] inline void report(const char* what, std::string_view detail) {
  std::fprintf(stderr, "fuzz: %s: %.*s\n", what, static_cast<int>(detail.size()), detail.data());
  std::abort();
}

template <class Parse>
void expect_value_or_refusal(Parse&& parse) {
  try {
    parse();
  } catch (const InputError& error) {
    const std::string_view message = error.what();
    if (message.empty() || message.find_first_of(std::string_view("\n\r\0", 3)) != std::string_view::npos)
      report("the refusal is not one line", message);
  }
}

/// First byte of the input, which chooses between readings of the rest; taken off.
inline unsigned take_choice(std::string_view& bytes, unsigned num_choices) {
  if (bytes.empty()) return 0;
  const unsigned choice = static_cast<unsigned char>(bytes.front()) % num_choices;
  bytes.remove_prefix(1);
  return choice;
}

/// A file of this process, for parsers that read a path; in /dev/shm where there is one.
class InputFile {
 public:
  explicit InputFile(const std::string& name) {
    std::error_code error;
    const std::filesystem::path memory = "/dev/shm";
    folder_ = std::filesystem::is_directory(memory, error) ? memory : std::filesystem::temp_directory_path();
    folder_ /= "earshot_fuzz_" + std::to_string(::getpid());
    std::filesystem::create_directories(folder_);
    path_ = folder_ / name;
  }
  ~InputFile() {
    std::error_code error;
    std::filesystem::remove_all(folder_, error);
  }
  InputFile(const InputFile&) = delete;
  InputFile& operator=(const InputFile&) = delete;

  const std::filesystem::path& write(std::string_view bytes) const {
    std::FILE* file = std::fopen(path_.c_str(), "wb");
    if (!file || std::fwrite(bytes.data(), 1, bytes.size(), file) != bytes.size() || std::fclose(file) != 0)
      report("cannot write", path_.string());
    return path_;
  }
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }

 private:
  std::filesystem::path folder_, path_;
};

}  // namespace earshot::fuzz
