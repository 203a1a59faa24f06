// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace earshot {

/// Expands "PREFIX A..B REST" to one text per whole number in [A, B]; text without a range stays alone.  Throws InputError: over 100,000,
/// or B < A.
std::vector<std::string> expand_range(const std::string& text);
/// The same of each text, in order.
std::vector<std::string> expand_ranges(const std::vector<std::string>& texts);
/// Expands ranges, and folders to the sound files in them by name order.
std::vector<std::string> expand_sounds(const std::vector<std::string>& sounds);

}  // namespace earshot
