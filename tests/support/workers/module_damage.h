// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <caffe2/serialize/inline_container.h>
#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <cstring>
#include <exception>
#include <memory>
#include <new>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/file_descriptor.h"
#include "sim/base/process/confinement.h"
#include "tests/support/workers/script_modules.h"

namespace earshot {

/// A file within a TorchScript file.
struct ModuleRecord {
  std::string name, bytes;
};

/// Without those that the writer adds by itself.
inline std::vector<ModuleRecord> records_of(const std::string& file) {
  std::istringstream stream(file);
  caffe2::serialize::PyTorchStreamReader reader(&stream);
  std::vector<ModuleRecord> records;
  for (const std::string& name : reader.getAllRecords()) {
    if (name == "version" || name.starts_with(".data/")) continue;
    const auto [data, size] = reader.getRecord(name);
    records.push_back({name, std::string(static_cast<const char*>(data.get()), size)});
  }
  return records;
}

/// A file of these records with lengths and checksums that are right.
inline std::string file_of(const std::vector<ModuleRecord>& records) {
  std::string file;
  {
    caffe2::serialize::PyTorchStreamWriter writer([&](const void* bytes, std::size_t count) {
      file.append(static_cast<const char*>(bytes), count);
      return count;
    });
    for (const ModuleRecord& record : records) writer.writeRecord(record.name, record.bytes.data(), record.bytes.size());
    writer.writeEndOfFile();
  }
  return file;
}

/// The end of a process that read a module and tried it out, with the limits of the process of a policy but less memory and time.
struct ModuleEnd {
  enum class Kind {
    works,
    refused,  ///< by one line
    stopped,  ///< by a limit or a crash of libtorch
    wrong,    ///< by another error, by several lines, or not at all
  };
  Kind kind = Kind::wrong;
  std::string text = {};
};

inline std::string read_and_tried(const std::string& file, pid_t caller) {
  try {
    take_on_limits({.caller = caller, .memory_bytes = std::uint64_t{512} << 20, .cpu_seconds = 10});
    static_cast<void>(give_up_files());
    static_cast<void>(ModulePolicyImpl(pointgoal_only(), {}, std::make_shared<const std::string>(file), "net.pt"));
    return "works";
  } catch (const InputError& error) {
    return std::string("refused ") + error.what();
  } catch (const std::bad_alloc&) {
    return "refused needs more memory";
  } catch (const std::exception& error) {
    return std::string("wrong ") + error.what();
  }
}

/// Call it before this process has run a backward pass: libtorch refuses those of a process that was forked behind one.
inline ModuleEnd end_of_module(const std::string& file) {
  std::array<int, 2> ends{};
  if (::pipe(ends.data()) != 0) return {.text = "no pipe"};
  const Descriptor reading(ends[0]);
  Descriptor writing(ends[1]);
  const pid_t caller = ::getpid(), child = ::fork();
  if (child == 0) {
    const std::string text = read_and_tried(file, caller);
    static_cast<void>(!::write(writing.get(), text.data(), std::min<std::size_t>(text.size(), 4000)));
    ::_exit(0);
  }
  writing = Descriptor();
  std::string text(4000, '\0');
  pollfd answer{.fd = reading.get(), .events = POLLIN, .revents = 0};
  constexpr int wait_ms = 60'000;  // the processor may have others to serve
  const bool has_ended = ::poll(&answer, 1, wait_ms) > 0;
  text.resize(has_ended ? static_cast<std::size_t>(std::max<ssize_t>(0, ::read(reading.get(), text.data(), text.size()))) : 0);
  if (!has_ended) ::kill(child, SIGKILL);
  int status = 0;
  ::waitpid(child, &status, 0);
  if (!has_ended) return {.text = "neither ends nor meets a limit"};
  if (text.empty()) return {ModuleEnd::Kind::stopped, WIFSIGNALED(status) ? ::strsignal(WTERMSIG(status)) : "ends without a word"};
  if (text == "works") return {ModuleEnd::Kind::works, text};
  const bool is_refusal = text.starts_with("refused ") && text.find_first_of(std::string_view("\n\r\0", 3)) == std::string::npos;
  return {is_refusal ? ModuleEnd::Kind::refused : ModuleEnd::Kind::wrong, text};
}

}  // namespace earshot
