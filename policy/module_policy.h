// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "envs/sensors/observation.h"
#include "policy/observation_tensors.h"
#include "policy/policy_config.h"
#include "policy/policy_network.h"
#include "policy/script_module.h"

namespace earshot {

/// The bytes of a file PolicyConfig::module.  Throws InputError: missing, no regular file, over kMaxModuleBytes.
std::shared_ptr<const std::string> read_module_file(const std::filesystem::path& path);

/// A network of the user's: a TorchScript module (docs/howto/own_network.md) with the methods
///
///   forward(observations: Dict[str, Tensor], state: Tensor) -> Tuple[Tensor, Tensor, Tensor]       logits, value, state
///   initial_state() -> Tensor                                                                      optional; of one env
///   sequence(observations, state, begins: Tensor) -> Tuple[Tensor, Tensor, Tensor]                 optional; of [T, N, ...]
///
/// Initial weights are those of the file; PolicyConfig::initial_stop_logit is added to the logit of stop, and normalize_values puts a
/// linear layer of one output behind the value.  guided_critic: in training, the observations hold goal_state.  goal_heads: a fourth
/// tensor. The module runs in evaluation mode: dropout is off, and batch norm uses its buffers.
class ModulePolicyImpl : public PolicyNetworkImpl {
 public:
  /// Tries the module on drawn observations.  Throws InputError, one line that begins with `where`: what ScriptModule throws, an
  /// observation that is off, an output that lacks or has another shape or type than needed, outputs that differ from call to call or
  /// depend on the other rows, a sequence that differs from its steps, buffers that change.
  ModulePolicyImpl(const ObservationSpec& spec, const PolicyConfig& config, std::shared_ptr<const std::string> file,
                   const std::string& where);

  PolicyOutput sequence(const ObservationTensors& observations, const torch::Tensor& hidden, const torch::Tensor& not_done) override;
  [[nodiscard]] int hidden_size() const override { return hidden_size_; }
  void set_value_scale(double mean, double deviation) override;
  [[nodiscard]] std::string architecture() const override;
  [[nodiscard]] std::shared_ptr<const std::string> module_file() const override { return file_; }

 private:
  void register_tensors();
  void read_initial_state();
  [[nodiscard]] ObservationTensors seen(const ObservationTensors& observations, std::initializer_list<std::int64_t> leading) const;
  [[nodiscard]] torch::Tensor initial_state();
  [[nodiscard]] torch::Tensor begin_state(const torch::Tensor& state, const torch::Tensor& not_done, const torch::Tensor& initial) const;
  PolicyOutput whole_sequence(const ObservationTensors& observations, const torch::Tensor& hidden, const torch::Tensor& not_done);
  PolicyOutput by_steps(const ObservationTensors& observations, const torch::Tensor& hidden, const torch::Tensor& not_done);
  PolicyOutput checked(const std::string& method, std::vector<torch::Tensor> outputs, std::vector<std::int64_t> leading) const;
  [[nodiscard]] std::string expected_inputs() const;
  void try_out();

  ScriptModule module_;
  std::shared_ptr<const std::string> file_;
  std::string where_;
  std::vector<SensorSpec> sensors_;
  bool has_memory_ = false, has_sequence_ = false;
  bool has_passed_trial_ = false;  ///< tried out: what goes wrong later is no fault of the input
  std::vector<std::int64_t> state_shape_ = {1};
  int hidden_size_ = 1;
  torch::Tensor value_weight_ = {}, value_bias_ = {};  ///< [1], of normalize_values
};

}  // namespace earshot
