// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace earshot {

/// Adds what the agents of an env did to a JSON object: `actions` of the first, a digit for each, and where there are further agents
/// `others`, a text of digits for each of them.
void write_actions(nlohmann::json& object, const std::vector<std::int8_t>& actions,
                   const std::vector<std::vector<std::int8_t>>& other_agents);

/// Reads them.  fail(what) is called, and throws, for actions and numbers of agents that cannot be; nlohmann::json::exception: a field is
/// missing or of another type.
void read_actions(const nlohmann::json& object, std::vector<std::int8_t>& actions, std::vector<std::vector<std::int8_t>>& other_agents,
                  const std::function<void(const std::string& problem)>& fail);

}  // namespace earshot
