// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/script.h>

#include <memory>
#include <sstream>
#include <string>

#include "policy/module_policy.h"
#include "tests/support/workers/pointgoal_policy.h"

namespace earshot {

/// The recurrent network behind a point goal, in TorchScript; %HIDDEN% stands for the size of its state.
inline const std::string kGruSource = R"JIT(
def initial_state(self) -> Tensor:
    return torch.zeros([%HIDDEN%])

def forward(self, observations: Dict[str, Tensor], state: Tensor) -> Tuple[Tensor, Tensor, Tensor]:
    after = torch.gru_cell(observations["pointgoal"], state, self.weight_ih, self.weight_hh, self.bias_ih, self.bias_hh)
    logits = torch.matmul(after, self.actor_weight.t()) + self.actor_bias
    value = torch.matmul(after, self.critic_weight.t()) + self.critic_bias
    return logits, value, after
)JIT";
/// A method for kGruSource that goes through the steps by itself.
inline const std::string kGruSequence = R"JIT(
def sequence(self, observations: Dict[str, Tensor], state: Tensor, begins: Tensor) -> Tuple[Tensor, Tensor, Tensor]:
    logits: List[Tensor] = []
    values: List[Tensor] = []
    for t in range(begins.size(0)):
        state = torch.where(begins[t].unsqueeze(1), torch.zeros_like(state), state)
        l, v, state = self.forward({"pointgoal": observations["pointgoal"][t]}, state)
        logits.append(l)
        values.append(v.squeeze(1))
    return torch.stack(logits), torch.stack(values), state
)JIT";

inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size())) text.replace(at, from.size(), to);
  return text;
}

/// kGruSource for an agent that hears and does not see.
inline const std::string kHearingSource = replaced(kGruSource, "observations[\"pointgoal\"]", "observations[\"spectrogram\"].mean([1, 2])");

inline std::string bytes_of(const torch::jit::Module& module) {
  std::ostringstream stream;
  module.save(stream);
  return stream.str();
}

/// A module of `source` with the weights of a built-in network of pointgoal_policy(), by their names with underscores.
inline torch::jit::Module module_like(const ActorCritic& network, const std::string& source) {
  torch::jit::Module module("Net");
  for (const auto& item : network->named_parameters()) {
    std::string name = replaced(item.key(), "rnn.", "");
    name = replaced(name, ".", "_");
    module.register_parameter(name, item.value().detach().clone(), false);
  }
  for (const auto& item : module.named_parameters()) item.value.requires_grad_(true);
  module.define(replaced(source, "%HIDDEN%", std::to_string(network->hidden_size())));
  return module;
}

inline std::shared_ptr<const std::string> file_like(const ActorCritic& network, const std::string& source) {
  return std::make_shared<const std::string>(bytes_of(module_like(network, source)));
}

}  // namespace earshot
