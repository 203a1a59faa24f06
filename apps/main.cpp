#include <fmt/format.h>

#include <cstdio>
#include <exception>

#include "apps/board_commands.h"
#include "apps/commands.h"
#include "sim/base/errors.h"
#include "sim/base/version.h"

namespace {

constexpr int kExitFailed = 1, kExitBadInput = 2;

int fail(int code, const char* what) {
  fmt::print(stderr, "earshot: {}\n", what);
  return code;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Earshot: a runtime in which reinforcement-learning agents see and hear", "earshot"};
  app.set_version_flag("--version", fmt::format("earshot {}", earshot::kVersion));
  app.require_subcommand(1);
  app.footer(
      "SCENE is a mesh file (glb, gltf, obj, ply, stl), shoebox:XxYxZ[@M], house:SEED[,rooms=N][,area_m2=A][,detail_m=D], "
      "floor:SEED[,width_m=W][,length_m=L][,detail_m=D], or a scene YAML.\n"
      "Exit codes: 0 done, 1 a run that failed, 2 bad usage or bad input.");

  int exit_code = 0;
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  earshot::add_doctor(app);
  earshot::add_scene(app);
  earshot::add_materials(app);
  earshot::add_rir(app);
  earshot::add_render(app);
  earshot::add_walk(app);
  earshot::add_dataset(app);
  earshot::add_train(app, arguments, exit_code);
  earshot::add_plan(app);
  earshot::add_keys(app);
  earshot::add_eval(app, arguments, exit_code);
  earshot::add_policy(app);
  earshot::add_verify(app);
  earshot::add_leaderboard(app);
  earshot::add_benchmark(app);
  earshot::add_replay(app);
  earshot::add_sweep(app);
  earshot::add_bench(app, arguments, exit_code);
  earshot::add_completion(app);

  try {
    app.parse(argc, argv);
    return exit_code;
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // --help, --version
    return fail(kExitBadInput, fmt::format("{} (see earshot --help)", error.what()).c_str());
  } catch (const earshot::InputError& error) {
    return fail(kExitBadInput, error.what());
  } catch (const std::exception& error) {
    return fail(kExitFailed, error.what());
  }
}
