// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <set>
#include <string>
#include <string_view>

namespace earshot {

/// ASCII letters to lower case, other bytes unchanged; no locale.
std::string fold_case(std::string_view text);

/// Whether all of `text` matches `pattern`, in which * stands for any characters and ? for one byte.  O(pattern x text).
bool glob_match(std::string_view pattern, std::string_view text);

/// The candidate nearest to `word` by edit distance, or empty if none is within a third of its length.
std::string nearest_word(std::string_view word, const std::set<std::string>& candidates);

/// The candidate nearest to `word` by edit distance, or empty if none is within a third of its length.
std::string nearest_word(std::string_view word, const std::set<std::string>& candidates);

}  // namespace earshot
