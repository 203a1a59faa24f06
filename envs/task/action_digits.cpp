// SPDX-License-Identifier: Apache-2.0
#include "envs/task/action_digits.h"

#include "envs/task/action.h"
#include "envs/task/episode.h"

namespace earshot {
namespace {

std::string digits_of(const std::vector<std::int8_t>& actions) {
  std::string digits;
  for (const std::int8_t action : actions) digits += static_cast<char>('0' + action);
  return digits;
}

}  // namespace

void write_actions(nlohmann::json& object, const std::vector<std::int8_t>& actions,
                   const std::vector<std::vector<std::int8_t>>& other_agents) {
  object["actions"] = digits_of(actions);
  for (const auto& further : other_agents) object["others"].push_back(digits_of(further));
}

void read_actions(const nlohmann::json& object, std::vector<std::int8_t>& actions, std::vector<std::vector<std::int8_t>>& other_agents,
                  const std::function<void(const std::string& problem)>& fail) {
  const auto read = [&](const nlohmann::json& digits) {
    std::vector<std::int8_t> all;
    for (const char digit : digits.get_ref<const std::string&>()) {
      if (digit < '0' || digit >= '0' + kNumActions) fail("contains an unknown action");
      all.push_back(static_cast<std::int8_t>(digit - '0'));
    }
    return all;
  };
  actions = read(object.at("actions"));
  other_agents.clear();
  const auto further = object.find("others");
  if (further == object.end()) return;
  if (!further->is_array() || further->size() >= kMaxAgents) fail("contains too many agents");
  for (const nlohmann::json& digits : *further) other_agents.push_back(read(digits));
}

}  // namespace earshot
