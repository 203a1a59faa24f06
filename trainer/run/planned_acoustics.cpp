// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/planned_acoustics.h"

#include <fmt/format.h>

#include "envs/config/env_accuracy.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/process/progress.h"
#include "sim/base/text/config_reader.h"
#include "sim/base/text/listed.h"

namespace earshot {
namespace {

/// Raised where the same file would come to give other acoustics.
constexpr const char* kPlanVersion = "1";

std::string plan_text(const RunConfig& config, const EnvAccuracy& accuracy) {
  const AccuracyChoice& choice = accuracy.plan.choice();
  std::string text = fmt::format("# Acoustic settings planned for env.accuracy \"{}\" in {}; delete this file to plan again.\n",
                                 config.env.accuracy, config.train.file);
  text += fmt::format("method: {}\npredicted: {}\nscenes_tried: {}\nms_per_source: {:.1f}\nms_per_response: {:.3f}\nacoustics:\n",
                      choice.method, text_of(choice.predicted), accuracy.scenes, choice.per_source_ms, choice.per_pose_ms);
  for (const std::string& setting : settings_of(choice)) {
    const std::size_t equals = setting.find('=');
    text += fmt::format("  {}: {}\n", setting.substr(0, equals), setting.substr(equals + 1));
  }
  return text;
}

RunConfig read_plan(const RunConfig& config, const std::filesystem::path& file) {
  ConfigReader reader = ConfigReader::from_file(file);
  std::string unused;
  for (const char* key : {"method", "predicted", "scenes_tried", "ms_per_source", "ms_per_response"})
    reader.read_required(key, unused, Allowed::any(), "What the planner tried and predicts, for readers.");
  RunConfig planned = config;
  planned.env.accuracy.clear();
  ConfigReader acoustics = reader.child("acoustics", "Acoustics that the planner chose.");
  for (const std::string_view key : {"rays", "source_rays", "early_order", "field"})
    if (!acoustics.has(std::string(key))) acoustics.fail(std::string(key), "is missing");
  read(acoustics, planned.env.acoustics);
  acoustics.finish();
  reader.finish();
  validate(planned.env);
  return planned;
}

}  // namespace

std::filesystem::path acoustics_plan_file(const RunConfig& config, const std::filesystem::path& folder) {
  if (config.train.file.empty())
    throw InputError("env.accuracy", "needs data.train.file: it is planned on the episodes of that set",
                     "set data.train.file to an episode set");
  EnvConfig asked;
  asked.task = config.env.task;
  asked.navmesh = config.env.navmesh;
  asked.acoustics = config.env.acoustics;
  asked.acoustics.threads = 1;  // has no part in the choice
  asked.scene_root = config.env.scene_root;
  const std::string depends_on = fmt::format("{}\n{}\n{}\n{}", kPlanVersion, AccuracyTarget::parse(config.env.accuracy).text(),
                                             hex64(load_episode_set(config.train.file).hash), config_text(asked));
  return folder / fmt::format("acoustics_{}.yaml", hex64(hash64(depends_on)));
}

std::optional<RunConfig> with_kept_acoustics(const RunConfig& config, const std::vector<std::filesystem::path>& folders) {
  if (config.env.accuracy.empty()) return config;
  const std::filesystem::path name = acoustics_plan_file(config, {}).filename();
  for (const std::filesystem::path& folder : folders)
    if (std::filesystem::exists(folder / name)) return read_plan(config, folder / name);
  return std::nullopt;
}

RunConfig plan_acoustics(const RunConfig& config) {
  Progress progress("acoustics", "%", 100);
  const EnvAccuracy accuracy = plan_env_accuracy(config.env, load_episode_set(config.train.file),
                                                 [&](double fraction) { progress.update(static_cast<std::uint64_t>(100 * fraction)); });
  const std::filesystem::path file = acoustics_plan_file(config, config.out);
  write_file_atomically(file, plan_text(config, accuracy));
  const AccuracyChoice& choice = accuracy.plan.choice();
  fmt::print("env.accuracy {}: {} (cheapest of {} candidates in {} scenes of {}), predicted {}; written to {}\n", config.env.accuracy,
             choice.method, accuracy.plan.tried.size(), accuracy.scenes, config.train.file, text_of(choice.predicted), file.string());
  fmt::print("  {}\n", listed(settings_of(choice), " "));
  return read_plan(config, file);
}

}  // namespace earshot
