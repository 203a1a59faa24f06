// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/engine_process.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <nlohmann/json.hpp>
#include <thread>

#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/stopwatch.h"
#include "sim/base/text/json.h"

namespace earshot {
namespace {

using nlohmann::json;

[[noreturn]] void refuse(const EngineCommand& engine, const std::string& problem) {
  throw InputError("engine " + engine.name, problem,
                   "see docs/evidence/accuracy.md for the files that a command reads and writes, or leave the engine out");
}

/// The last message, on one line.
std::string last_line(const std::filesystem::path& log) {
  std::string text = std::filesystem::exists(log) ? read_file(log, std::size_t{1} << 26) : std::string();
  while (!text.empty() && (text.back() == '\n' || text.back() == '\r')) text.pop_back();
  const std::size_t line = text.find_last_of('\n');
  return line == std::string::npos ? text : text.substr(line + 1);
}

/// Exit code of `/bin/sh -c command`, standard output and error in `log`; -1 where a signal ended it.
int run_shell(const EngineCommand& engine, const std::string& command, const std::filesystem::path& log, double timeout_s) {
  posix_spawn_file_actions_t actions{};
  posix_spawnattr_t attributes{};
  posix_spawn_file_actions_init(&actions);
  posix_spawnattr_init(&attributes);
  posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, 1, log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
  posix_spawn_file_actions_adddup2(&actions, 1, 2);
  // A separate process group: processes of the shell end with it.
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
  posix_spawnattr_setpgroup(&attributes, 0);
  std::string shell = "sh", option = "-c", script = command;
  char* const arguments[] = {shell.data(), option.data(), script.data(), nullptr};
  pid_t child = 0;
  const int failed = posix_spawn(&child, "/bin/sh", &actions, &attributes, arguments, environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  if (failed != 0) refuse(engine, "could not be started: error " + std::to_string(failed));
  const Stopwatch watch;
  int status = 0;
  for (;;) {
    const pid_t ended = ::waitpid(child, &status, WNOHANG);
    if (ended == child) {
      ::kill(-child, SIGKILL);  // its background processes
      break;
    }
    if (ended < 0 && errno != EINTR) refuse(engine, "was lost: waitpid failed");
    if (watch.wall_s() > timeout_s) {
      ::kill(-child, SIGKILL);
      while (::waitpid(child, &status, 0) < 0 && errno == EINTR) continue;
      refuse(engine, fmt::format("took longer than {:g} s", timeout_s));
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

json triple(const glm::dvec3& v) { return json::array({v.x, v.y, v.z}); }

json request_of(const ShoeboxRoom& room, double seconds_per_response) {
  json listeners = json::array(), absorption = json::array();
  for (const glm::dvec3& listener : room.listeners_m) listeners.push_back(triple(listener));
  for (const auto& wall : room.absorption) absorption.push_back(wall);
  return {{"version", 1},
          {"size_m", triple(room.size_m)},
          {"walls", {"x0", "x1", "y0", "y1", "z0", "z1"}},
          {"bands_hz", room.bands_hz},
          {"absorption", absorption},
          {"scattering", 0.0},
          {"air_absorption", false},
          {"source_m", triple(room.source_m)},
          {"listeners_m", listeners},
          {"speed_of_sound_m_per_s", room.speed_of_sound_m_per_s},
          {"sample_rate_hz", room.sample_rate_hz},
          {"length_s", room.length_s},
          {"seconds_per_response", seconds_per_response}};
}

void read_result(const EngineCommand& engine, const std::filesystem::path& file, std::size_t listeners, EngineAnswer& answer) {
  if (!std::filesystem::exists(file)) refuse(engine, "wrote no result.json");
  const json result = parse_json_or_discard(read_file(file, std::size_t{1} << 24));
  if (!result.is_object() || !result.contains("seconds") || !result["seconds"].is_array() || result["seconds"].size() != listeners)
    refuse(engine, fmt::format("wrote a result.json without `seconds`, one number for each of {} listeners", listeners));
  for (const json& seconds : result["seconds"]) {
    if (!seconds.is_number() || !(seconds.get<double>() > 0))
      refuse(engine, "wrote a result.json with seconds that are not positive numbers");
    answer.seconds_per_response += seconds.get<double>() / static_cast<double>(listeners);
  }
  if (result.contains("setting") && result["setting"].is_string()) answer.setting = result["setting"].get<std::string>();
}

}  // namespace

EngineCommand EngineCommand::parse(const std::string& text) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0 || equals + 1 == text.size())
    throw InputError("--engine " + text, "is not NAME=COMMAND", "write a name for the tables, =, and the command that runs the engine");
  const std::string name = text.substr(0, equals);
  if (std::ranges::any_of(name, [](char c) { return c == '|' || static_cast<unsigned char>(c) < ' '; }))
    throw InputError("--engine " + text, "has a name with | or control characters", "choose another name");
  return {name, text.substr(equals + 1)};
}

std::string shell_quoted(const std::string& text) {
  std::string word = "'";
  for (const char c : text) word += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return word + "'";
}

EngineAnswer ask_engine(const EngineCommand& engine, const ShoeboxRoom& room, double seconds_per_response,
                        const std::filesystem::path& folder, double timeout_s) {
  const std::size_t listeners = room.listeners_m.size();
  const auto wav = [&](std::size_t listener) { return folder / fmt::format("listener_{}.wav", listener); };
  std::filesystem::remove(folder / "result.json");  // of a run before
  for (std::size_t l = 0; l < listeners; ++l) std::filesystem::remove(wav(l));
  const std::filesystem::path request = folder / "request.json", log = folder / "log.txt";
  write_file_atomically(request, json_text(request_of(room, seconds_per_response), 2) + "\n");
  const int code = run_shell(engine, engine.command + " " + shell_quoted(std::filesystem::absolute(request).string()), log, timeout_s);
  EngineAnswer answer;
  if (code == kEngineUnavailable || (code != 0 && engine.optional)) {
    answer.available = false;
    answer.note = last_line(log);
    return answer;
  }
  if (code != 0) {
    const std::string said = last_line(log);
    refuse(engine, fmt::format("failed with exit code {}{}", code, said.empty() ? "" : ": " + said));
  }
  read_result(engine, folder / "result.json", listeners, answer);
  for (std::size_t l = 0; l < listeners; ++l) {
    if (!std::filesystem::exists(wav(l))) refuse(engine, "wrote no " + wav(l).filename().string());
    try {
      answer.responses.push_back(load_sound(wav(l), static_cast<float>(room.sample_rate_hz)).samples);
    } catch (const InputError& error) {
      refuse(engine, fmt::format("wrote a {} that cannot be read: {}", wav(l).filename().string(), error.what()));
    }
  }
  return answer;
}

}  // namespace earshot
