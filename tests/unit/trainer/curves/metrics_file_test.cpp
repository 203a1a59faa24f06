// SPDX-License-Identifier: Apache-2.0
#include "trainer/curves/metrics_file.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <regex>
#include <set>
#include <sstream>

#include "sim/base/files.h"
#include "tests/support/workers/worker_processes.h"

namespace earshot {
namespace {

const CurvePoint kPoint{12,
                        3456,
                        7.5,
                        {{"episodes/success", 0.25},
                         {"episodes/dtg_m", 3},
                         {"policy/explained_variance", std::numeric_limits<double>::quiet_NaN()},
                         {"time/steps_per_s", 100},
                         {"time/learn_s", 0.5},
                         {"guards/lost_workers", 1},
                         {"workers/0/update_s", 2},
                         {"workers/3/update_s", 2.5},
                         {"policy/loss", std::numeric_limits<double>::infinity()}}};

TEST(MetricsFile, SaysWhatPrometheusReads) {
  EXPECT_EQ(prometheus_text({1, 2, 3, {{"time/learn_s", 0.5}, {"workers/3/update_s", 2.5}}}, "a \"b\""),
            "# HELP earshot_update_total Curve update of the last update (docs/howto/training.md).\n"
            "# TYPE earshot_update_total counter\n"
            "earshot_update_total{run=\"a \\\"b\\\"\"} 1\n"
            "# HELP earshot_env_steps_total Curve env_steps of the last update (docs/howto/training.md).\n"
            "# TYPE earshot_env_steps_total counter\n"
            "earshot_env_steps_total{run=\"a \\\"b\\\"\"} 2\n"
            "# HELP earshot_training_seconds Curve training_s of the last update (docs/howto/training.md).\n"
            "# TYPE earshot_training_seconds gauge\n"
            "earshot_training_seconds{run=\"a \\\"b\\\"\"} 3\n"
            "# HELP earshot_time_learn_seconds Curve time/learn_s of the last update (docs/howto/training.md).\n"
            "# TYPE earshot_time_learn_seconds gauge\n"
            "earshot_time_learn_seconds{run=\"a \\\"b\\\"\"} 0.5\n"
            "# HELP earshot_workers_update_seconds Curve workers/update_s of the last update (docs/howto/training.md).\n"
            "# TYPE earshot_workers_update_seconds gauge\n"
            "earshot_workers_update_seconds{run=\"a \\\"b\\\"\",worker=\"3\"} 2.5\n");
}

// The grammar of the format: every line a comment or a sample; one HELP and one TYPE per family, before its samples, no family twice.
TEST(MetricsFile, IsWellFormed) {
  const std::regex sample(R"re(([a-zA-Z_:][a-zA-Z0-9_:]*)\{run="r"(,worker="\d+")?\} (-?[0-9.e+-]+|\+Inf|-Inf))re");
  const std::regex comment(R"re(# (HELP|TYPE) ([a-zA-Z_:][a-zA-Z0-9_:]*) .+)re");
  std::istringstream lines(prometheus_text(kPoint, "r"));
  std::set<std::string> helped, typed;
  std::string line, family;
  std::smatch match;
  int samples = 0;
  while (std::getline(lines, line)) {
    if (std::regex_match(line, match, comment)) {
      EXPECT_TRUE((match[1] == "HELP" ? helped : typed).insert(match[2]).second) << line;
      family = match[2];
    } else {
      ASSERT_TRUE(std::regex_match(line, match, sample)) << line;
      EXPECT_EQ(match[1], family);
      ++samples;
    }
  }
  EXPECT_EQ(helped, typed);
  EXPECT_EQ(samples, 11);  // three of the point, eight of nine values
  EXPECT_TRUE(helped.contains("earshot_episodes_dtg_meters") && helped.contains("earshot_time_steps_per_second") &&
              helped.contains("earshot_guards_lost_workers_total"));
}

TEST(MetricsFile, IsReplacedWhole) {
  const PrivateTestFolder folder;
  const auto file = folder.path() / "earshot.prom";
  write_metrics_file(file, kPoint, "first");
  write_metrics_file(file, kPoint, "second");
  EXPECT_EQ(read_file(file), prometheus_text(kPoint, "second"));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1);  // and no temporary stays
}

}  // namespace
}  // namespace earshot
