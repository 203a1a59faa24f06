// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/env_states.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "envs/batch/env_state.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/log.h"
#include "trainer/checkpoint/env_places.h"

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

void refuse_bad_state(const torch::Tensor& hidden, const std::filesystem::path& path) {
  if (!torch::isfinite(hidden).all().item<bool>())
    throw InputError(path.string(), "contains a recurrent state with non-finite values", "use an earlier checkpoint");
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
  refuse_bad_state(checkpoint.hidden.at(rank), path);
  env.restore(checkpoint.env_states[rank]);
  collector.restore(checkpoint.hidden.at(rank), checkpoint.not_done.at(rank),
                    checkpoint.oracle_acted.empty() ? torch::Tensor() : checkpoint.oracle_acted.at(rank));
}

void move_env_states(const Checkpoint& checkpoint, const std::filesystem::path& path, WorkerIdentity identity, std::uint64_t seed,
                     std::uint64_t set_hash, BatchedEnv& env, RolloutCollector& collector) {
  const std::size_t saved = checkpoint.env_states.size();
  if (saved == 0 || checkpoint.hidden.size() != saved || checkpoint.not_done.size() != saved)
    throw InputError(path.string(), "contains no environments", "use an earlier checkpoint");
  const bool fits = decode_env_state(checkpoint.env_states.front()).set_hash == set_hash;
  const int num_envs = env.num_envs(), first = identity.rank * num_envs;
  const int saved_workers = fits ? static_cast<int>(saved) : 0, saved_envs = static_cast<int>(checkpoint.hidden.front().size(0));
  if (identity.rank == 0)
    log_info(fits ? moved_envs_text(saved_workers, saved_envs, identity.world_size, num_envs)
                  : std::string("another episode set: all environments start with new episodes"));

  std::vector<std::uint64_t> seeds;
  for (int place = first; place < first + num_envs; ++place)
    seeds.push_back(hash64(fmt::format("begins {} {}", place, checkpoint.update), seed));
  torch::Tensor hidden = torch::zeros_like(collector.hidden()), not_done = torch::zeros_like(collector.not_done()),
                oracle_acted = torch::zeros_like(collector.oracle_acted());
  std::vector<std::vector<std::string>> snapshots(saved);  // of the workers that these environments come from
  env.reset(std::vector<std::uint8_t>(seeds.size(), 1), seeds);
  for (int i = 0; i < num_envs; ++i) {
    const auto origin = origin_of_env(first + i, saved_workers, saved_envs);
    if (!origin) continue;
    const auto rank = static_cast<std::size_t>(origin->rank);
    if (snapshots[rank].empty()) {
      refuse_bad_state(checkpoint.hidden[rank], path);
      snapshots[rank] = snapshots_of(checkpoint.env_states[rank]);
      if (snapshots[rank].size() != static_cast<std::size_t>(saved_envs) || checkpoint.hidden[rank].sizes() != checkpoint.hidden[0].sizes())
        throw InputError(path.string(), "has workers with different numbers of environments", "use an earlier checkpoint");
    }
    env.restore(i, snapshots[rank][static_cast<std::size_t>(origin->env)]);
    hidden[i] = checkpoint.hidden[rank][origin->env];
    not_done[i] = checkpoint.not_done[rank][origin->env];
    if (!checkpoint.oracle_acted.empty()) oracle_acted[i] = checkpoint.oracle_acted.at(rank)[origin->env];
  }
  collector.restore(hidden, not_done, oracle_acted);
}

}  // namespace earshot
