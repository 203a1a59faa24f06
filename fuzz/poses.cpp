// SPDX-License-Identifier: Apache-2.0
// CSV files of timed poses.
#include <cmath>

#include "apps/options/timed_path.h"
#include "fuzz/fuzz_target.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  static const fuzz::InputFile file("poses.csv");
  fuzz::expect_value_or_refusal([&] {
    const std::vector<TimedPose> path = read_timed_path(file.write(fuzz::text_of(data, size)).string());
    for (const double fraction : {-1.0, 0.0, 0.3, 1.0, 2.0}) {
      const TimedPose pose = pose_at(path, path.front().t_s + fraction * (path.back().t_s - path.front().t_s));
      if (!std::isfinite(pose.position.x) || !std::isfinite(pose.heading_deg)) fuzz::report("a pose that is not finite", "");
    }
  });
  return 0;
}
