// SPDX-License-Identifier: Apache-2.0
#include "apps/program.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <new>
#include <set>
#include <string_view>

#include "apps/options/decimal_options.h"
#include "apps/options/output_options.h"
#include "sim/base/errors.h"
#include "sim/base/process/exit_codes.h"
#include "sim/base/text/config_reader.h"
#include "sim/base/text/listed.h"
#include "sim/base/version.h"
#include "trainer/net/ring_config.h"

namespace earshot {
namespace {

constexpr const char* kVersionFlag = "--version";

std::vector<const CLI::App*> commands_of(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App*) { return true; });
}

const CLI::App* find_command(const CLI::App& app, const std::string& word) {
  for (const CLI::App* command : commands_of(app))
    if (command->check_name(word)) return command;
  return nullptr;
}

/// Throws InputError where a word names no command, or where none is left to name one: "bench rirs", "bench".
void check_commands(const CLI::App& app, const std::vector<std::string>& words) {
  std::string before;
  const CLI::App* level = &app;
  for (std::size_t i = 0; !commands_of(*level).empty(); ++i) {
    if (i < words.size() && words[i].starts_with('-')) return;  // --help
    const CLI::App* command = i < words.size() ? find_command(*level, words[i]) : nullptr;
    if (command == nullptr) {
      std::set<std::string> names;
      for (const CLI::App* known : commands_of(*level)) names.insert(known->get_name());
      const std::string all = fmt::format("one of: {}", listed(names, ", "));
      if (i == words.size()) throw InputError(before.empty() ? "earshot" : before.substr(0, before.size() - 1), "needs a command", all);
      const std::string nearest = nearest_word(words[i], names);
      throw InputError(before + words[i], "is not a command", nearest.empty() ? all : fmt::format("did you mean '{}{}'?", before, nearest));
    }
    before += words[i] + " ";
    level = command;
  }
}

/// libtorch says so by an exception of its own.
bool is_out_of_memory(const std::exception& error) {
  const std::string_view message = error.what();
  return dynamic_cast<const std::bad_alloc*>(&error) != nullptr || message.find("allocate memory") != std::string_view::npos ||
         message.find("not enough memory") != std::string_view::npos;
}

/// One line, whatever the library that threw has to say below it, and without an exception of its own where the output is closed.
int fail(int code, const std::string& message) {
  std::fputs(("earshot: " + message.substr(0, message.find('\n')) + "\n").c_str(), stderr);
  return code;
}

}  // namespace

Program::Program(int argc, char** argv)
    : argc_(argc),
      argv_(argv),
      arguments_(argv + (argc > 0 ? 1 : 0), argv + argc),
      app_("Earshot: a runtime in which reinforcement-learning agents see and hear", "earshot") {
  app_.set_version_flag(kVersionFlag, fmt::format("earshot {}", kVersion));
  app_.require_subcommand(1);
  app_.parse_complete_callback([this] { check_outputs_of(app_); });  // behind the whole line, before the command
  app_.footer(
      "SCENE is a mesh file (glb, gltf, obj, ply, stl; FILE,unit=0.01,up=z names unit and up axis), a point cloud (ply, pcd, xyz, las; "
      "FILE,cell=0.05 names the voxels), a scene of Habitat (scene_instance.json; scene_dataset_config.json,scene=NAME), "
      "shoebox:XxYxZ[@M], "
      "house:SEED[,rooms=N][,area_m2=A][,detail_m=D], "
      "floor:SEED[,width_m=W][,length_m=L][,detail_m=D], or a scene YAML.\n" +
      exit_code_table());
}

bool Program::has_requested_command() const {
  if (arguments_.empty()) return false;
  return arguments_.front() == kVersionFlag || find_command(app_, arguments_.front()) != nullptr;
}

int Program::run() {
  try {
    check_commands(app_, arguments_);
    read_decimal_numbers(app_);
    app_.parse(argc_, argv_);
    return exit_code_;
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app_.exit(error);  // --help, --version
    return fail(kExitBadInput, fmt::format("{} (see earshot --help)", error.what()));
  } catch (const std::exception& error) {
    return report_failure(error);
  }
}

void continue_as(const std::filesystem::path& program, char** argv) {
  ::execv(program.c_str(), argv);
  throw RunError(program.string(), fmt::format("cannot be started: {}", std::strerror(errno)));
}

int report_failure(const std::exception& error) {
  if (is_out_of_memory(error)) {
    fail(kExitFailed, fmt::format("out of memory: {}", error.what()));
    std::_Exit(kExitFailed);  // library cleanup may wait for memory too
  }
  const bool is_input = dynamic_cast<const InputError*>(&error) != nullptr;
  const bool is_loss = dynamic_cast<const WorldLost*>(&error) != nullptr || dynamic_cast<const LeftOut*>(&error) != nullptr;
  return fail(is_input ? kExitBadInput : is_loss ? kExitLostWorld : kExitFailed, error.what());
}

}  // namespace earshot
