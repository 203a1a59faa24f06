// SPDX-License-Identifier: Apache-2.0
// The part of evaluation/results/policy_process.h that runs in the process of the policy.
#include <fcntl.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>

#include "evaluation/results/policy_process.h"
#include "policy/actor_critic.h"
#include "policy/script_module.h"
#include "policy/torch_threads.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/process/child_program.h"
#include "sim/base/process/confinement.h"
#include "sim/base/process/frame_channel.h"
#include "sim/base/text/json.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/rollout/actor.h"
#include "trainer/run/run_config.h"

namespace earshot {
namespace {

constexpr std::uint64_t kMaxRequestBytes = std::uint64_t{1} << 32;  // of the process that is trusted

/// What libtorch opens and allocates at its first use happens before the rights to do so are given up.
void warm_up() {
  ObservationSpec sensors;
  sensors.camera.width_px = sensors.camera.height_px = 40;
  PolicyConfig small;
  small.hidden_size = small.visual_features = small.audio_features = 8;
  ActorCritic policy(sensors, small);
  policy->eval();
  Actor actor(policy, 0, 1);
  ObservationTensors observations;
  for (const SensorSpec& sensor : sensor_table(sensors, 1))
    observations.sensors.push_back({sensor.name, torch::zeros(sizes_of(sensor, {1}), scalar_type(sensor.type))});
  static_cast<void>(actor.observe(observations));
  warm_up_script_modules();
}

/// The policy and its batch, as requests make them.
class PolicyHost {
 public:
  /// Answers with config and hash.
  std::string load(const std::string& request) {
    const std::size_t zero = request.find('\0');
    where_ = request.substr(0, zero);
    checkpoint_ = decode_checkpoint(std::string_view(request).substr(std::min(request.size(), zero + 1)), where_);
    return json_text(nlohmann::json{{"config", checkpoint_.config_yaml},
                                    {"policy_hash", hex64(hash_of(checkpoint_.weights, hash64(checkpoint_.architecture)))}});
  }

  void begin(const std::string& request) {
    const nlohmann::json json = parse_json(request);
    ConfigReader reader = ConfigReader::from_text(json.at("env").get<std::string>(), "the environment", {});
    EnvConfig env;
    read(reader, env);
    reader.finish();
    const RunConfig config = config_of_policy(checkpoint_.config_yaml, where_);
    const PolicyNetwork policy = network_of(checkpoint_, env.observation, config.policy, where_);
    num_rows_ = json.at("rows").get<std::size_t>();
    is_argmax_ = json.at("argmax").get<bool>();
    seed_ = json.at("seed").get<std::uint64_t>();
    for (const nlohmann::json& row : json.at("sensors")) {
      SensorSpec sensor;
      row.at("name").get_to(sensor.name);
      row.at("shape").get_to(sensor.shape);
      sensor.type = static_cast<SensorType>(row.at("type").get<int>());
      buffers_.sensors.push_back(
          {sensor.name, torch::zeros(sizes_of(sensor, {static_cast<std::int64_t>(num_rows_)}), scalar_type(sensor.type))});
    }
    actor_.emplace(policy, 0, static_cast<int>(num_rows_));
  }

  std::string step(const std::string& request) {
    std::vector<PolicyRow> rows(num_rows_);
    std::string_view left = request;
    const auto take = [&](void* to, std::size_t bytes) {
      if (left.size() < bytes) throw RunError(where_, "a step of another size");
      std::memcpy(to, left.data(), bytes);
      left.remove_prefix(bytes);
    };
    take(rows.data(), rows.size() * sizeof(PolicyRow));
    for (auto& [name, tensor] : buffers_.sensors) take(tensor.data_ptr(), tensor.nbytes());
    if (hidden_.defined()) actor_->restore(hidden_, not_done(rows));  // what Actor::advance does with the flags of a batch
    const PolicyOutput& output = actor_->observe(buffers_);
    hidden_ = output.hidden;
    std::vector<std::int32_t> actions(num_rows_);
    if (is_argmax_) {
      greedy_actions(output.logits, actions);
    } else {
      std::vector<ActingEnv> acting;
      for (const PolicyRow& row : rows) acting.push_back({row.episode, 0, row.step});
      sample_actions(output.logits, acting, seed_, actions);
    }
    return {reinterpret_cast<const char*>(actions.data()), actions.size() * sizeof(std::int32_t)};
  }

 private:
  /// [rows], 0 where the current observation begins an episode.
  static torch::Tensor not_done(const std::vector<PolicyRow>& rows) {
    torch::Tensor flags = torch::ones({static_cast<std::int64_t>(rows.size())});
    for (std::size_t i = 0; i < rows.size(); ++i)
      if (rows[i].has_ended != 0) flags[static_cast<std::int64_t>(i)] = 0.f;
    return flags;
  }

  std::string where_;
  Checkpoint checkpoint_;
  std::size_t num_rows_ = 0;
  bool is_argmax_ = false;
  std::uint64_t seed_ = 0;
  ObservationTensors buffers_;
  torch::Tensor hidden_;  ///< behind the last step; undefined before the first
  std::optional<Actor> actor_;
};

void reply(FrameChannel& channel, PolicyMessage kind, std::string_view bytes) {
  const std::array parts{bytes};
  if (channel.send(static_cast<std::uint64_t>(kind), parts, std::nullopt) != FrameChannel::Status::done) ::_exit(0);
}

void serve(FrameChannel& channel, bool can_open_files) {
  PolicyHost host;
  for (;;) {
    std::uint64_t kind = 0;
    std::string request;
    if (channel.receive(kind, request, kMaxRequestBytes, std::nullopt) != FrameChannel::Status::done) return;
    std::string answer;
    switch (static_cast<PolicyMessage>(kind)) {
      case PolicyMessage::hello:
        answer = can_open_files ? "files" : "";
        break;
      case PolicyMessage::load:
        answer = host.load(request);
        break;
      case PolicyMessage::begin:
        host.begin(request);
        break;
      case PolicyMessage::step:
        answer = host.step(request);
        break;
      default:
        return;
    }
    reply(channel, PolicyMessage::answer, answer);
  }
}

/// Of libtorch too, which says so by an exception of its own.
bool is_out_of_memory(std::string_view message) {
  const auto says = [&](std::string_view words) { return message.find(words) != std::string_view::npos; };
  return says("allocate memory") || says("not enough memory") || says("bad_alloc");
}

}  // namespace

int serve_policy(int argc, char** argv) {
  constexpr int num_arguments = 5;  // program, word, caller, memory, seconds
  if (argc != num_arguments || ::fcntl(kAnswerDescriptor, F_GETFD) < 0) {
    std::fputs("policy-process: internal to 'earshot eval --benchmark'; do not run it directly\n", stderr);
    return 2;
  }
  std::uint64_t memory_bytes = 0;
  FrameChannel channel{Descriptor(kAnswerDescriptor)};
  std::string refusal;
  try {
    memory_bytes = number_argument(argv[3]);
    use_one_torch_thread();
    warm_up();
    // In this order: limits are measured by a file.
    take_on_limits(
        {.caller = static_cast<pid_t>(number_argument(argv[2])), .memory_bytes = memory_bytes, .cpu_seconds = number_argument(argv[4])});
    serve(channel, !give_up_files());
    ::_exit(0);
  } catch (const std::bad_alloc&) {
    refusal = "needs more memory";
  } catch (const std::exception& error) {
    const std::string_view message = error.what();
    refusal = is_out_of_memory(message) ? "needs more memory" : message.substr(0, message.find('\n'));
  }
  if (refusal == "needs more memory") refusal = fmt::format("needs more than {} MB of memory", memory_bytes >> 20);
  reply(channel, PolicyMessage::refusal, std::string_view(refusal).substr(0, 4000));
  ::_exit(0);  // without destructors, which may want memory
}

}  // namespace earshot
