// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "policy/policy_network.h"
#include "trainer/run/run_config.h"

namespace earshot {

/// The weights of config.initial_policy (a policy file, checkpoint or run folder), for a run that starts from them.  Throws InputError: no
/// such file, damaged, or of another architecture than `config` asks for; then nothing has changed.
void load_initial_policy(const RunConfig& config, const PolicyNetwork& policy);
/// Before workers are started: makes the network that the config asks for, and loads the weights of the checkpoint to resume into it, or of
/// config.initial_policy without one.  Throws InputError as they do.
void check_policy(const RunConfig& config, const std::filesystem::path& resume);

}  // namespace earshot
