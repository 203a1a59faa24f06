// SPDX-License-Identifier: Apache-2.0
// earshot: the commands that do without libtorch, which takes longer to load than most of them take.  It passes all other commands to
// earshot_training, which has every one.

#include <exception>

#include "apps/commands.h"
#include "apps/program.h"
#include "sim/base/process/companion_program.h"

int main(int argc, char** argv) {
  earshot::Program program(argc, argv);
  earshot::add_scene(program.app());
  earshot::add_materials(program.app());
  earshot::add_rir(program.app());
  earshot::add_measure(program.app());
  earshot::add_validate(program.app());
  earshot::add_fit_materials(program.app());
  earshot::add_render(program.app());
  earshot::add_walk(program.app());
  earshot::add_dataset(program.app());
  if (program.has_requested_command()) return program.run();
  try {
    earshot::continue_as(earshot::companion_program("earshot_training"), argv);
  } catch (const std::exception& error) {
    return earshot::report_failure(error);
  }
}
