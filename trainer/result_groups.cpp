#include "trainer/result_groups.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr std::string_view kSynthetic = "synth:";

std::string group_of(const EvaluationResult::Row& row, GroupBy by) {
  switch (by) {
    case GroupBy::novelty:
      return row.novelty;
    case GroupBy::kind:
      return row.sound.empty() ? "" : sound_kind(row.sound);
    case GroupBy::scene:
      return row.scene;
  }
  return {};
}

std::string cell(const Estimate& estimate) { return fmt::format("{:.3f} [{:.3f}, {:.3f}]", estimate.mean, estimate.low, estimate.high); }

}  // namespace

std::string sound_kind(std::string_view sound) {
  if (!sound.starts_with(kSynthetic)) return "recording";
  sound.remove_prefix(kSynthetic.size());
  return std::string(sound.substr(0, sound.find(':')));
}

void note_novelty(EvaluationResult& result, std::span<const std::string> trained) {
  const std::set<std::string, std::less<>> sounds(trained.begin(), trained.end());
  std::set<std::string> kinds;
  for (const std::string& sound : trained) kinds.insert(sound_kind(sound));
  for (EvaluationResult::Row& row : result.episodes)
    row.novelty = sounds.contains(row.sound) ? "heard" : kinds.contains(sound_kind(row.sound)) ? "unheard" : "unheard kind";
}

std::string groups_text(const std::vector<EvaluationResult>& results, GroupBy by) {
  std::string text = fmt::format("{:<16} {:<28} {:>8} {:>6}  {:<22} {:<22} {:<22}\n", "agent", "group", "episodes", "share", "success",
                                 "when silent", "SPL");
  for (const EvaluationResult& result : results) {
    std::map<std::string, EvaluationResult> groups;
    for (const EvaluationResult::Row& row : result.episodes) {
      const std::string name = group_of(row, by);
      if (name.empty())
        throw InputError(result.agent,
                         by == GroupBy::novelty ? "is a result that does not say which sounds the training had"
                                                : "is a result that does not say which sounds its episodes had",
                         by == GroupBy::novelty ? "evaluate it again with a config (--config) that names data.train.sounds"
                                                : "evaluate it again with this program");
      groups[name].episodes.push_back(row);
    }
    for (const auto& [name, group] : groups)
      text += fmt::format("{:<16} {:<28} {:>8} {:>4.0f} %  {:<22} {:<22} {:<22}\n", result.agent, name, group.episodes.size(),
                          100.0 * static_cast<double>(group.episodes.size()) / static_cast<double>(result.episodes.size()),
                          cell(group.success()), cell(group.success_when_silent()), cell(group.spl()));
  }
  return text;
}

}  // namespace earshot
