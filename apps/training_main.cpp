// SPDX-License-Identifier: Apache-2.0
// earshot_training: all commands of earshot, which starts it for those that need libtorch, for the help, and for words that it does not
// know.

#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <string_view>

#include "apps/board/board_commands.h"
#include "apps/commands.h"
#include "apps/program.h"
#include "evaluation/results/policy_process.h"

namespace {

int run(int argc, char** argv) {
  if (argc > 1 && std::string_view(argv[1]) == earshot::kPolicyProcessWord) return earshot::serve_policy(argc, argv);
  earshot::Program program(argc, argv);
  CLI::App& app = program.app();
  earshot::add_doctor(app);
  earshot::add_scene(app);
  earshot::add_materials(app);
  earshot::add_rir(app);
  earshot::add_measure(app);
  earshot::add_validate(app);
  earshot::add_fit_materials(app);
  earshot::add_render(app);
  earshot::add_walk(app);
  earshot::add_dataset(app);
  earshot::add_train(app, program.arguments(), program.exit_code());
  earshot::add_plan(app);
  earshot::add_keys(app);
  earshot::add_config(app);
  earshot::add_eval(app, program.arguments(), program.exit_code());
  earshot::add_policy(app);
  earshot::add_verify(app);
  earshot::add_leaderboard(app);
  earshot::add_benchmark(app);
  earshot::add_replay(app);
  earshot::add_sweep(app, program.exit_code());
  earshot::add_bench(app, program.arguments(), program.exit_code());
  earshot::add_completion(app);
  return program.run();
}

}  // namespace

int main(int argc, char** argv) {
  const int code = run(argc, argv);
#ifdef NDEBUG
  // Without the end of three hundred libraries, a fifth of the time of a short command: libtorch takes back what it registered, operator by
  // operator.  Other builds end in full, for what finds leaks and counts lines then.
  std::cout.flush();
  std::fflush(nullptr);
  std::_Exit(code);
#else
  return code;
#endif
}
