// SPDX-License-Identifier: Apache-2.0
#pragma once

/// @file
/// Trained policies, and agents that act by them.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>

#include "earshot/config.h"
#include "earshot/env.h"

namespace earshot::api {

/// Weights of a trained agent with the config that they were trained by.  Copies share the weights.  Component `training`, which needs
/// libtorch; this header does not.
class Policy {
 public:
  /// Reads a policy file, a checkpoint, or the newest checkpoint of a run folder.
  /// @throws InputError if there is none that is whole.
  static Policy load(const std::filesystem::path& path);
  /// A policy with the first weights of a run config (a function of its policy.seed).
  static Policy untrained(const Config& run);

  [[nodiscard]] std::string description() const;  ///< a few lines: name, architecture, parameters, steps of training, engine
  [[nodiscard]] std::string config_text() const;  ///< the run config with every key, as YAML: what VectorEnv takes
  [[nodiscard]] std::uint64_t hash() const;       ///< of architecture and weights
  [[nodiscard]] std::int64_t num_parameters() const;
  /// Writes a policy file, without the state of a training.
  /// @param path     file to write.
  /// @param float16  half the bytes; each weight then differs by at most 2^-11 of itself.
  void save(const std::filesystem::path& path, bool float16 = false) const;

  struct Model;
  [[nodiscard]] const std::shared_ptr<const Model>& model() const { return model_; }  ///< for the library

 private:
  explicit Policy(std::shared_ptr<const Model> model) : model_(std::move(model)) {}
  std::shared_ptr<const Model> model_;
};

/// How an agent chooses its actions.
struct AgentOptions {
  bool sample = true;      ///< drawn from the policy's distribution; else the likeliest action
  std::uint64_t seed = 0;  ///< of the draws
};

/// A policy acting in a batch: its recurrent state, one per row.
///
/// \code
/// const auto policy = earshot::Policy::load("configs/policies/quick.policy");
/// earshot::VectorEnv envs(earshot::Config::from_text(policy.config_text()), episodes, 8);
/// earshot::Agent agent(policy, envs);
/// envs.reset();
/// for (int step = 0; step < 200; ++step) {
///   envs.step(agent.act());
///   agent.observe_step();
/// }
/// \endcode
///
/// Rows whose observation is not finite are zeroed before the policy sees them.  One thread at a time.
class Agent {
 public:
  /// @param policy   whose sensors the batch has.
  /// @param envs     must outlive the agent; it may move.
  /// @param options  sampling and its seed.
  /// @throws InputError if the batch lacks a sensor of the policy, or its shape differs.
  Agent(const Policy& policy, const VectorEnv& envs, const AgentOptions& options = {});
  ~Agent();
  Agent(Agent&&) noexcept;

  /// One action per row for the current observations; valid until the next call.
  std::span<const std::int32_t> act();
  /// Takes over the state after envs.step(), and begins anew where an episode has ended.
  void observe_step();

 private:
  struct Model;
  std::unique_ptr<Model> model_;
};

}  // namespace earshot::api
