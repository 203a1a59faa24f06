// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "trainer/launch/launcher_environment.h"

namespace earshot {

/// The job that this process belongs to, under a name that stays the same when its launcher starts it again after a failure: of Slurm, PBS,
/// LSF, torchrun, Open MPI, or EARSHOT_RUN_ID, the outermost first.  Empty: none.
std::string launcher_job(const Variables& variables);
/// Of the environment of this process.
std::string launcher_job();

}  // namespace earshot
