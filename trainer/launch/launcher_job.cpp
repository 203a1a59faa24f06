// SPDX-License-Identifier: Apache-2.0
#include "trainer/launch/launcher_job.h"

#include <array>
#include <cstdlib>

#include "trainer/launch/worker_names.h"

namespace earshot {
namespace {

/// Variables of a batch system come first: a launcher inside may choose another name at each start.
/// The user's own name comes before those of launchers inside.
constexpr std::array kJobNames{"SLURM_JOB_ID", "PBS_JOBID", "LSB_JOBID", kRunIdName, "TORCHELASTIC_RUN_ID", "PMIX_NAMESPACE"};

}  // namespace

std::string launcher_job(const Variables& variables) {
  for (const char* name : kJobNames)
    if (const auto found = variables.find(name); found != variables.end() && !found->second.empty()) return name + (" " + found->second);
  return {};
}

std::string launcher_job() {
  Variables variables;
  for (const char* name : kJobNames)
    if (const char* value = std::getenv(name)) variables[name] = value;
  return launcher_job(variables);
}

}  // namespace earshot
