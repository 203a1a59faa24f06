// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "envs/episodes/episode_set.h"
#include "sim/base/errors.h"

namespace earshot {

/// What the reader says of an episode whose text has `to` in the place of the first `from`; "accepted" if it takes it.
inline std::string refusal_of_changed(const Episode& episode, const std::string& from, const std::string& to) {
  std::string changed = episode_set_text({episode});
  changed.replace(changed.find(from), from.size(), to);
  try {
    static_cast<void>(parse_episode_set(changed, "set"));
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

}  // namespace earshot
