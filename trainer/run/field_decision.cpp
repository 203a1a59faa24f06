// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/field_decision.h"

#include <fmt/format.h>

#include "envs/config/field_choice.h"
#include "trainer/checkpoint/find_checkpoint.h"

namespace earshot {
namespace {

FieldDecision decide(const RunConfig& config, const std::filesystem::path& resume) {
  FieldDecision decision{.config = config, .text = {}};
  Switch& field = decision.config.env.acoustics.field;
  if (field != Switch::automatic || !config.env.observation.hears()) return decision;
  if (!resume.empty()) {
    const std::string yaml = load_checkpoint_metadata(resume).config_yaml;
    field = parse_run_config(yaml, resume.string() + " (its config)", {}).env.acoustics.field;
    if (field != Switch::automatic) {
      decision.text = fmt::format("env.acoustics.field auto: {}, as in the resumed run", field == Switch::on ? "on" : "off");
      return decision;
    }
  }
  field = Switch::off;
  if (config.train.file.empty() || !std::filesystem::exists(config.train.file)) {
    decision.text = "env.acoustics.field auto: off, because there is no training set to count the listeners per source";
    return decision;
  }
  const FieldChoice choice =
      choose_field(config.env.acoustics, load_episode_set(config.train.file), static_cast<double>(config.total_steps));
  if (choice.on) field = Switch::on;
  decision.text = "env.acoustics.field auto: " + choice.text();
  return decision;
}

}  // namespace

FieldDecision decide_field(const RunConfig& config, const std::filesystem::path& resume) {
  FieldDecision decision = decide(config, resume);
  EnvConfig& env = decision.config.env;
  if (env.acoustics.field == Switch::on && env.field_store.empty())
    env.field_store = (std::filesystem::path(config.out) / "fields").string();
  return decision;
}

}  // namespace earshot
