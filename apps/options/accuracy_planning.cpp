// SPDX-License-Identifier: Apache-2.0
#include "apps/options/accuracy_planning.h"

#include <fmt/format.h>

#include "sim/base/process/progress.h"
#include "sim/base/text/listed.h"

namespace earshot {

AccuracyPlan plan_and_print(const AcousticScene& acoustics, const AccuracyTarget& target, const SoundSource& source,
                            const std::vector<glm::vec3>& places, double poses) {
  Progress progress("calibration", "%", 100);
  AccuracyPlan plan = plan_accuracy(acoustics, target, source, places, poses,
                                    [&](double fraction) { progress.update(static_cast<std::uint64_t>(100 * fraction)); });
  const AccuracyChoice& choice = plan.choice();
  fmt::print("accuracy {}: {} (cheapest of {} candidates; calibration took {:.1f} s)\n", target.text(), choice.method, plan.tried.size(),
             plan.calibration_s);
  fmt::print("  predicted {}; {:.1f} ms per source, {:.2f} ms per response\n", text_of(choice.predicted), choice.per_source_ms,
             choice.per_pose_ms);
  fmt::print("  reproduce these bits with --set {}\n", listed(settings_of(choice), " --set "));
  return plan;
}

}  // namespace earshot
