#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "trainer/result.h"

namespace earshot {

/// What a sound is one of: "telephone" of `synth:telephone:3`, "recording" of a file.
std::string sound_kind(std::string_view sound);

/// Notes in each row what its sound was to the training: "heard", "unheard" (another of a kind that was heard) or "unheard kind".
/// trained: the sounds of data.train, without ranges or folders (expand_sounds).
void note_novelty(EvaluationResult& result, std::span<const std::string> trained);

/// By what the episodes of a result are told apart.
enum class GroupBy { novelty, kind, scene };

/// Success, success when silent and SPL of each agent by group, with the number of episodes and their fraction of all: a table of text.
/// Throws InputError for results without what they are to be told apart by.
std::string groups_text(const std::vector<EvaluationResult>& results, GroupBy by);

}  // namespace earshot
