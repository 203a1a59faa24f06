// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/env_states.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "sim/base/errors.h"

namespace earshot {
namespace {

// Tensors travel as raw floats.
std::string bytes_of(const torch::Tensor& tensor) {
  return std::string(reinterpret_cast<const char*>(tensor.data_ptr<float>()), static_cast<std::size_t>(tensor.numel()) * sizeof(float));
}

torch::Tensor tensor_of(const std::string& bytes, torch::IntArrayRef shape) {
  torch::Tensor tensor = torch::empty(shape);
  if (bytes.size() != static_cast<std::size_t>(tensor.numel()) * sizeof(float))
    throw RunError("checkpoint", "the workers have hidden states of different sizes");
  std::copy(bytes.begin(), bytes.end(), reinterpret_cast<char*>(tensor.data_ptr<float>()));
  return tensor;
}

}  // namespace

void gather_env_states(Collective& collective, const BatchedEnv& env, const RolloutCollector& collector, Checkpoint& checkpoint) {
  const torch::Tensor hidden = collector.hidden(), not_done = collector.not_done(), oracle_acted = collector.oracle_acted();
  std::vector<std::string> states = collective.all_gather(env.save_state());
  const std::vector<std::string> hiddens = collective.all_gather(bytes_of(hidden));
  const std::vector<std::string> starts = collective.all_gather(bytes_of(not_done));
  const std::vector<std::string> guided = collective.all_gather(bytes_of(oracle_acted));
  for (std::size_t rank = 0; rank < states.size(); ++rank) {
    checkpoint.hidden.push_back(tensor_of(hiddens[rank], hidden.sizes()));
    checkpoint.not_done.push_back(tensor_of(starts[rank], not_done.sizes()));
    checkpoint.oracle_acted.push_back(tensor_of(guided[rank], oracle_acted.sizes()));
  }
  checkpoint.env_states = std::move(states);
}

void restore_env_states(const Checkpoint& checkpoint, const std::filesystem::path& path, WorkerIdentity identity, BatchedEnv& env,
                        RolloutCollector& collector) {
  if (checkpoint.env_states.size() != static_cast<std::size_t>(identity.world_size))
    throw InputError(
        path.string(),
        fmt::format("contains the environments of {} workers instead of {}", checkpoint.env_states.size(), identity.world_size),
        "use an earlier checkpoint");
  const auto rank = static_cast<std::size_t>(identity.rank);
  if (!torch::isfinite(checkpoint.hidden.at(rank)).all().item<bool>())
    throw InputError(path.string(), "contains a recurrent state with non-finite values", "use an earlier checkpoint");
  env.restore(checkpoint.env_states[rank]);
  collector.restore(checkpoint.hidden.at(rank), checkpoint.not_done.at(rank),
                    checkpoint.oracle_acted.empty() ? torch::Tensor() : checkpoint.oracle_acted.at(rank));
}

}  // namespace earshot
