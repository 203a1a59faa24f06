// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/policy_process.h"

#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "envs/task/action.h"
#include "evaluation/results/sensed_config.h"
#include "sim/base/control_characters.h"
#include "sim/base/errors.h"
#include "sim/base/process/child_program.h"
#include "sim/base/process/frame_channel.h"
#include "sim/base/temporary_folder.h"
#include "sim/base/text/config_reader.h"
#include "sim/base/text/json.h"
#include "sim/base/text/log.h"
#include "trainer/run/effective_config.h"
#include "trainer/run/run_config.h"

namespace earshot {
namespace {

constexpr std::uint64_t kMaxDescriptionBytes = std::uint64_t{1} << 20;
constexpr std::uint64_t kMaxRefusalBytes = 4096;
/// Others may hold secrets of a job.
const std::vector<std::string> kPassedVariables{"PATH",   "LD_LIBRARY_PATH", "LD_PRELOAD",   "HOME",          "LANG",
                                                "LC_ALL", "TMPDIR",          "ASAN_OPTIONS", "UBSAN_OPTIONS", "LSAN_OPTIONS"};
constexpr const char* kRemedy = "ask its author for another file, or allow more with --policy-memory-gb and --policy-seconds";

std::string_view row_bytes(std::span<const PolicyRow> rows) { return {reinterpret_cast<const char*>(rows.data()), rows.size_bytes()}; }

std::string begin_text(const BatchedEnv& env, ActionChoice choice, std::uint64_t seed) {
  nlohmann::json sensors = nlohmann::json::array();
  for (const SensorSpec& sensor : env.sensors())
    sensors.push_back({{"name", sensor.name}, {"type", static_cast<int>(sensor.type)}, {"shape", sensor.shape}});
  EnvConfig config = env.config();
  for (std::string* folder : {&config.scene_root, &config.sound_root, &config.field_store, &config.scene_store, &config.quarantine_dir})
    folder->clear();  // there it has no file
  return json_text(nlohmann::json{{"env", config_text(config)},
                                  {"rows", env.num_rows()},
                                  {"argmax", choice == ActionChoice::argmax},
                                  {"seed", seed},
                                  {"sensors", std::move(sensors)}});
}

}  // namespace

struct PolicyProcess::Impl {
  Impl(const CheckpointBytes& policy, const PolicyLimits& of_process)
      : where(policy.path.string()),
        limits(of_process),
        folder(temporary_parent(), "earshot-policy-"),
        pair(make_socket_pair()),
        channel(std::move(pair.ours)),
        child({.program = "/proc/self/exe",  // this build, also where its file has been replaced
               .arguments = {kPolicyProcessWord, std::to_string(::getpid()), std::to_string(limits.memory_bytes),
                             std::to_string(limits.cpu.count())},
               .descriptor = pair.theirs.get(),
               .folder = folder.path(),
               // Threads keep rights that Landlock takes from the one that asks.
               .variables = {"OMP_NUM_THREADS=1", "OPENBLAS_NUM_THREADS=1", "MKL_NUM_THREADS=1"},
               .passed = kPassedVariables}) {
    pair.theirs = Descriptor();  // so that its end shows
  }

  std::string where;
  PolicyLimits limits;
  TemporaryFolder folder;
  SocketPair pair;
  FrameChannel channel;
  ChildProgram child;
  std::string config_yaml, policy_hash;
  bool can_open_files = false, has_begun = false;
  std::vector<PolicyRow> rows;

  /// The answer to a request, of at most so many bytes.
  std::string ask(PolicyMessage request, std::span<const std::string_view> parts, std::uint64_t max_bytes) {
    const auto deadline = FrameChannel::Clock::now() + limits.answer;
    std::uint64_t kind = 0;
    std::string bytes;
    auto status = channel.send(static_cast<std::uint64_t>(request), parts, deadline);
    // A refusal may be waiting behind a request that was not read.
    if (status == FrameChannel::Status::done || status == FrameChannel::Status::closed)
      status = channel.receive(kind, bytes, std::max(max_bytes, kMaxRefusalBytes), deadline);
    if (status == FrameChannel::Status::done && kind == static_cast<std::uint64_t>(PolicyMessage::answer) && bytes.size() <= max_bytes)
      return bytes;
    if (status == FrameChannel::Status::done && kind == static_cast<std::uint64_t>(PolicyMessage::refusal)) refuse(bytes);
    if (status == FrameChannel::Status::timed_out) refuse(fmt::format("did not answer within {} s", limits.answer.count()));
    if (status == FrameChannel::Status::closed) refuse(manner_of_end());
    refuse("gives an answer that is no answer");
  }

  [[noreturn]] void refuse(std::string text) {
    child.end();
    text = printable(text);
    std::string place = where;  // or a part of it: "FILE (its module)"
    if (const std::size_t colon = text.find(": ", where.size()); text.starts_with(where) && colon != std::string::npos) {
      place = text.substr(0, colon);
      text.erase(0, colon + 2);
    }
    throw InputError(place, text, kRemedy);
  }

  std::string manner_of_end() {
    const std::optional<int> status = child.end(std::chrono::seconds(1));  // it ends after its socket
    if (status && WIFSIGNALED(*status)) {
      const int signal = WTERMSIG(*status);
      if (signal == SIGXCPU) return fmt::format("takes more than {} s of CPU time", limits.cpu.count());
      return fmt::format("ends its process (signal {}, {}), within {} MB of memory and {} s of CPU time", signal, ::strsignal(signal),
                         limits.memory_bytes >> 20, limits.cpu.count());
    }
    return "ends its process";
  }

  void load(const CheckpointBytes& policy) {
    can_open_files = !ask(PolicyMessage::hello, {}, kMaxRefusalBytes).empty();  // before it has read anything of others
    const std::array<std::string_view, 3> parts{where, std::string_view("\0", 1), policy.bytes};
    const std::string text = ask(PolicyMessage::load, parts, kMaxDescriptionBytes);
    try {
      const nlohmann::json description = parse_json(text);
      description.at("config").get_to(config_yaml);
      description.at("policy_hash").get_to(policy_hash);
    } catch (const std::exception&) {
      refuse("gives an answer that is no answer");
    }
    const auto is_hexadecimal = [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); };
    if (policy_hash.size() != 16 || !std::ranges::all_of(policy_hash, is_hexadecimal)) refuse("gives an answer that is no answer");
  }
};

PolicyProcess::PolicyProcess(const CheckpointBytes& policy, const PolicyLimits& limits) : impl_(std::make_unique<Impl>(policy, limits)) {
  impl_->load(policy);
}

PolicyProcess::~PolicyProcess() = default;

RunConfig config_of_policy(const std::string& yaml, const std::string& where) {
  const std::string part = where + " (its config)";
  ConfigReader env = ConfigReader::from_text(yaml, part).child("env", "Environments.");
  const ConfigReader observation = env.child("observation", "Sensors of the agents.");
  refuse_channels_of_file(observation.scalar("channels").value_or(""), part);  // before validation, which reads it
  return parse_effective_config(yaml, part, {"env.scene_root=\"\"", "env.sound_root=\"\"", "env.accuracy=\"\""});
}

const std::string& PolicyProcess::config_yaml() const { return impl_->config_yaml; }
const std::string& PolicyProcess::policy_hash() const { return impl_->policy_hash; }
bool PolicyProcess::can_open_files() const { return impl_->can_open_files; }

void PolicyProcess::act(const BatchedEnv& env, ActionChoice choice, std::uint64_t seed, std::span<std::int32_t> actions) {
  Impl& in = *impl_;
  const auto num_rows = static_cast<std::size_t>(env.num_rows());
  EARSHOT_EXPECT(actions.size() == num_rows);
  if (!std::exchange(in.has_begun, true)) {
    const std::string text = begin_text(env, choice, seed);
    const std::array<std::string_view, 1> parts{text};
    in.ask(PolicyMessage::begin, parts, 0);
    in.rows.assign(num_rows, {});
  }
  for (std::size_t i = 0; i < num_rows; ++i) {
    const auto& agent = env.agent(static_cast<int>(i));
    in.rows[i].episode = static_cast<std::uint32_t>(agent.episode_index);
    in.rows[i].step = static_cast<std::uint32_t>(agent.episode_step);
  }
  std::vector<std::string_view> parts{row_bytes(in.rows)};
  for (const SensorSpec& sensor : env.sensors()) {
    const std::span<const std::byte> rows = env.rows(sensor.name);
    parts.emplace_back(reinterpret_cast<const char*>(rows.data()), rows.size());
  }
  const std::string answer = in.ask(PolicyMessage::step, parts, actions.size_bytes());
  if (answer.size() != actions.size_bytes()) in.refuse("gives too few actions");
  std::memcpy(actions.data(), answer.data(), answer.size());
  for (const std::int32_t action : actions)
    if (action < 0 || action >= kNumActions) in.refuse("gives an action that there is not");
}

void PolicyProcess::advance(const BatchedEnv& env) {
  for (std::size_t i = 0; i < impl_->rows.size(); ++i)
    impl_->rows[i].has_ended = env.terminated()[i] != 0 || env.truncated()[i] != 0 ? 1 : 0;
}

}  // namespace earshot
