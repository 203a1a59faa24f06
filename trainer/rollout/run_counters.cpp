// SPDX-License-Identifier: Apache-2.0
#include "trainer/rollout/run_counters.h"

#include <fmt/format.h>

#include "envs/batch/batched_env.h"

namespace earshot {
namespace {

double fraction(double part, double whole) { return whole > 0 ? part / whole : 0; }

void mention(std::string& text, double count, const char* singular, const char* plural) {
  if (count > 0) text += fmt::format("{}{:.0f} {}", text.empty() ? "" : ", ", count, count == 1 ? singular : plural);
}

}  // namespace

RunCounters RunCounters::of(const BatchedEnv& env, const SceneCache& scenes, std::uint64_t num_sanitized_rows,
                            std::uint64_t num_dropped_rows, std::uint64_t num_ratio_alarms) {
  const BatchCounters batch = env.counters();
  const EffectCounters& effects = batch.effects;
  const FieldCounters fields = scenes.field_counters();
  const QuarantineCounters quarantine = env.quarantine_counters();
  RunCounters counters;
  const auto set = [&](Field field, auto value) { counters.values[field] = static_cast<double>(value); };
  set(poses, effects.poses);
  set(in_sight, effects.in_sight);
  set(without_transmission, effects.transmission_skipped);
  set(without_diffraction, effects.diffraction_skipped);
  set(without_early, effects.early_skipped);
  set(without_late, effects.late_skipped);
  set(from_field, effects.field_gathers);
  set(cached, batch.cached_responses);
  set(fields_built, fields.built);
  set(fields_loaded, fields.loaded);
  set(fields_shared, fields.shared);
  set(field_bytes, fields.bytes);
  set(field_seconds, fields.build_seconds + fields.load_seconds);
  set(quarantined, quarantine.total());
  set(without_path, quarantine.of(Fault::path));
  set(not_finite, quarantine.nonfinite());
  set(quarantine_files, quarantine.files_written);
  set(quarantine_files_failed, quarantine.files_failed);
  set(sanitized_rows, num_sanitized_rows);
  set(dropped_rows, num_dropped_rows);
  set(ratio_alarms, num_ratio_alarms);
  return counters;
}

void append_curve_values(std::vector<std::pair<std::string, double>>& values, const RunCounters& now, const RunCounters& before,
                         const GuardCounts& guards) {
  using Field = RunCounters::Field;
  const auto recent = [&](Field field) { return now[field] - before[field]; };
  for (const auto& [name, field] :
       std::initializer_list<std::pair<const char*, Field>>{{"hearing/in_sight", Field::in_sight},
                                                            {"hearing/without_transmission", Field::without_transmission},
                                                            {"hearing/without_diffraction", Field::without_diffraction},
                                                            {"hearing/without_early", Field::without_early},
                                                            {"hearing/without_late", Field::without_late},
                                                            {"hearing/from_field", Field::from_field}})
    values.emplace_back(name, fraction(recent(field), recent(Field::poses)));
  values.emplace_back("hearing/cached", fraction(recent(Field::cached), recent(Field::cached) + recent(Field::poses)));
  for (const auto& [name, field] : std::initializer_list<std::pair<const char*, Field>>{{"fields/built", Field::fields_built},
                                                                                        {"fields/loaded", Field::fields_loaded},
                                                                                        {"fields/shared", Field::fields_shared},
                                                                                        {"fields/seconds", Field::field_seconds},
                                                                                        {"guards/quarantined", Field::quarantined},
                                                                                        {"guards/without_path", Field::without_path},
                                                                                        {"guards/not_finite", Field::not_finite},
                                                                                        {"guards/sanitized_rows", Field::sanitized_rows},
                                                                                        {"guards/dropped_rows", Field::dropped_rows},
                                                                                        {"guards/ratio_alarms", Field::ratio_alarms}})
    values.emplace_back(name, now[field]);
  values.emplace_back("guards/skipped_steps", static_cast<double>(guards.skipped_steps));
  values.emplace_back("guards/loss_alarms", static_cast<double>(guards.loss_alarms));
  values.emplace_back("guards/kl_alarms", static_cast<double>(guards.kl_alarms));
  values.emplace_back("guards/failed_writes", static_cast<double>(guards.failed_writes));
  values.emplace_back("guards/lost_workers", static_cast<double>(guards.lost_workers));
  values.emplace_back("guards/joined_workers", static_cast<double>(guards.joined_workers));
}

std::string fault_summary(const RunCounters& counters, const GuardCounts& guards) {
  std::string text;
  mention(text, counters[RunCounters::quarantined], "episode quarantined", "episodes quarantined");
  mention(text, counters[RunCounters::sanitized_rows], "observation sanitized", "observations sanitized");
  mention(text, counters[RunCounters::dropped_rows], "row dropped", "rows dropped");
  mention(text, static_cast<double>(guards.skipped_steps), "step skipped", "steps skipped");
  mention(text, static_cast<double>(guards.loss_alarms), "loss alarm", "loss alarms");
  mention(text, static_cast<double>(guards.kl_alarms), "KL alarm", "KL alarms");
  mention(text, counters[RunCounters::ratio_alarms], "ratio alarm", "ratio alarms");
  mention(text, static_cast<double>(guards.failed_writes), "file not written", "files not written");
  mention(text, static_cast<double>(guards.lost_workers), "worker lost", "workers lost");
  mention(text, static_cast<double>(guards.joined_workers), "worker joined", "workers joined");
  return text;
}

std::string summary(const RunCounters& c, const GuardCounts& guards) {
  const double all = c[RunCounters::poses];
  const auto percent = [&](RunCounters::Field field) { return 100 * fraction(c[field], all); };
  std::string text = fmt::format(
      "heard:  {:.0f} poses, {:.0f} % in sight; without transmission {:.0f} %, diffraction {:.0f} %, early {:.0f} %, late {:.0f} %; "
      "late from a field {:.0f} %; {:.0f} responses cached\n",
      all, percent(RunCounters::in_sight), percent(RunCounters::without_transmission), percent(RunCounters::without_diffraction),
      percent(RunCounters::without_early), percent(RunCounters::without_late), percent(RunCounters::from_field), c[RunCounters::cached]);
  text += fmt::format("fields: {:.0f} built, {:.0f} loaded, {:.0f} shared, {:.1f} MB, {:.1f} s\n", c[RunCounters::fields_built],
                      c[RunCounters::fields_loaded], c[RunCounters::fields_shared], c[RunCounters::field_bytes] / 1e6,
                      c[RunCounters::field_seconds]);
  const std::string happened = fault_summary(c, guards);
  return text + fmt::format("guards: {} of {} steps taken, {}\n", guards.taken_steps, guards.taken_steps + guards.skipped_steps,
                            happened.empty() ? "nothing to report" : happened);
}

}  // namespace earshot
