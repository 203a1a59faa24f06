// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/lock_record.h"

#include <fmt/format.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <ctime>
#include <fstream>
#include <map>
#include <sstream>

#include "sim/base/errors.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

constexpr const char* kFirstLine = "earshot run lock 1";
constexpr std::size_t kMaxRecordBytes = 4096;

std::string this_host() {
  std::array<char, 256> name{};
  return ::gethostname(name.data(), name.size() - 1) == 0 && name[0] != '\0' ? name.data() : "unknown";
}

/// Empty where the system does not say.
std::string this_machine() {
  std::string boot;
  std::getline(std::ifstream("/proc/sys/kernel/random/boot_id"), boot);
  struct stat processes {};
  if (boot.empty() || ::stat("/proc/self/ns/pid", &processes) != 0) return {};
  return fmt::format("{}/{}", boot, processes.st_ino);
}

struct ProcessState {
  char state = '?';
  std::uint64_t began_ticks = 0;
};

/// proc(5), stat: the name in parentheses may hold anything, the state follows it, the start is 19 fields later.
std::optional<ProcessState> state_of(std::int64_t process) {
  std::ifstream file(fmt::format("/proc/{}/stat", process));
  std::string text;
  if (!std::getline(file, text)) return std::nullopt;
  const std::size_t end_of_name = text.rfind(')');
  if (end_of_name == std::string::npos) return std::nullopt;
  std::istringstream fields(text.substr(end_of_name + 1));
  ProcessState result;
  fields >> result.state;
  std::string skipped;
  for (int i = 0; i < 18; ++i) fields >> skipped;
  fields >> result.began_ticks;
  if (!fields) return std::nullopt;
  return result;
}

/// Whether SIGKILL is on its way to it: no code of its own will run again.
bool is_being_killed(std::int64_t process) {
  std::ifstream file(fmt::format("/proc/{}/status", process));
  for (std::string line; std::getline(file, line);) {
    if (!line.starts_with("SigPnd:") && !line.starts_with("ShdPnd:")) continue;
    std::uint64_t pending = 0;
    std::istringstream(line.substr(7)) >> std::hex >> pending;
    if ((pending >> 8 & 1) != 0) return true;
  }
  return false;
}

std::string one_line(std::string text) {
  for (char& c : text)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F) c = '?';
  return text.substr(0, 200);
}

}  // namespace

std::string LockRecord::holder() const { return fmt::format("process {} ({}) on host {}, since {}", process, command, host, since); }

LockRecord own_lock_record(const std::string& command, const std::string& job, const std::string& run) {
  LockRecord record;
  record.host = one_line(this_host());
  record.machine = this_machine();
  record.process = ::getpid();
  if (const auto state = state_of(record.process)) record.began_ticks = state->began_ticks;
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  ::gmtime_r(&now, &utc);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%SZ", &utc);
  record.since = text.data();
  record.command = one_line(command);
  record.job = one_line(job);
  std::uint64_t number = 0;
  if (::getrandom(&number, sizeof(number), 0) != sizeof(number)) throw RunError("getrandom", "gives no bytes");
  record.token = hex64(number);
  record.run = run.empty() ? record.token : run;
  return record;
}

std::string encode_lock_record(const LockRecord& record) {
  return fmt::format("{}\nkind {}\nhost {}\nmachine {}\nprocess {}\nbegan {}\nsince {}\nwhat {}\njob {}\nrun {}\ntoken {}\n", kFirstLine,
                     record.is_lease ? "lease" : "kernel", record.host, record.machine, record.process, record.began_ticks, record.since,
                     record.command, record.job, record.run, record.token);
}

std::optional<LockRecord> decode_lock_record(const std::string& text) {
  std::istringstream lines(text);
  std::string line;
  if (!std::getline(lines, line) || line != kFirstLine) return std::nullopt;
  std::map<std::string, std::string> values;
  while (std::getline(lines, line)) {
    if (lines.eof()) return std::nullopt;  // its end is still to come
    const std::size_t space = line.find(' ');
    if (space == std::string::npos) return std::nullopt;
    values[line.substr(0, space)] = line.substr(space + 1);
  }
  if (!values.contains("token")) return std::nullopt;
  LockRecord record{.is_lease = values["kind"] == "lease",
                    .host = one_line(values["host"]),
                    .machine = values["machine"],
                    .since = one_line(values["since"]),
                    .command = one_line(values["what"]),
                    .job = values["job"],
                    .token = values["token"],
                    .run = values["run"]};
  if (!(std::istringstream(values["process"]) >> record.process) || !(std::istringstream(values["began"]) >> record.began_ticks))
    return std::nullopt;
  return record;
}

std::optional<LockRecord> read_lock_record(int descriptor) {
  std::string text(kMaxRecordBytes, '\0');
  const ssize_t got = ::pread(descriptor, text.data(), text.size(), 0);
  if (got <= 0) return std::nullopt;
  text.resize(static_cast<std::size_t>(got));
  return decode_lock_record(text);
}

bool is_known_gone(const LockRecord& record) {
  if (record.machine.empty() || record.machine != this_machine()) return false;
  const auto state = state_of(record.process);
  return !state || state->began_ticks != record.began_ticks || state->state == 'Z' || state->state == 'X' ||
         is_being_killed(record.process);
}

}  // namespace earshot
