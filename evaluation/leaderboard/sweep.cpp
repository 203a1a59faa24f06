// SPDX-License-Identifier: Apache-2.0
#include "evaluation/leaderboard/sweep.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

bool is_plain(const std::string& name) {
  return !name.empty() && name.front() != '.' && std::ranges::all_of(name, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-' || c == '.';
  });
}

/// Seeds and folders belong to the sweep.
void refuse_own_keys(ConfigReader& reader, const std::string& key, const std::vector<std::string>& overrides) {
  for (const std::string& override : overrides)
    for (const char* reserved : {"seed", "out"})
      if (override.starts_with(std::string(reserved) + "="))
        reader.fail(key, fmt::format("sets '{}', which the sweep sets itself for each run", reserved));
}

}  // namespace

void read(ConfigReader& reader, SweepConfig& sweep) {
  reader.read("name", sweep.name, "Name of the sweep; default: of the file.");
  sweep.out = "runs/sweeps/" + sweep.name;
  reader.read("out", sweep.out, Allowed::text("a folder"), "Folder of the runs; default: runs/sweeps/NAME.");
  reader.read_required("config", sweep.config, Allowed::text("a run config"), "Run config that all runs start from.");
  reader.read_required("seeds", sweep.seeds, Allowed::any(), "Seeds; each run is trained once with each.");
  reader.read("set", sweep.set, Allowed::text("key=value"), "Keys of the run config for all runs, but seed and out.");
  refuse_own_keys(reader, "set", sweep.set);
  ConfigReader runs = reader.child("runs", "Runs by name: what each changes in the config; at least one.");
  for (const std::string& name : runs.free_keys("NAME")) {
    if (!is_plain(name)) runs.fail(name, "is not a valid run name: use letters, digits, '_', '-' and '.', because it becomes a folder");
    SweepConfig::Variant variant{.name = name, .overrides = {}};
    runs.read_required(name, variant.overrides, Allowed::text("key=value"),
                       "Keys of the run config for this run; [] for the config as it is.");
    refuse_own_keys(runs, name, variant.overrides);
    sweep.runs.push_back(std::move(variant));
  }
  runs.finish();
  reader.read("evaluate", sweep.evaluate, Allowed::text("key=value"),
              "Keys for the evaluation of each run on data.eval; [] for the config as trained. Absent: no evaluation.");
  if (sweep.evaluate) refuse_own_keys(reader, "evaluate", *sweep.evaluate);
}

SweepConfig load_sweep(const std::filesystem::path& path) {
  ConfigReader reader = ConfigReader::from_file(path);
  SweepConfig sweep{.name = path.stem().string(), .out = {}, .config = {}, .seeds = {}, .runs = {}};
  read(reader, sweep);
  if (sweep.seeds.empty()) reader.fail("seeds", "is empty: give at least one seed");
  if (std::set<std::uint64_t>(sweep.seeds.begin(), sweep.seeds.end()).size() != sweep.seeds.size())
    reader.fail("seeds", "contains a seed twice, which would repeat the run");
  if (sweep.runs.empty()) reader.fail("runs", "is missing or empty: list the runs, for example {base: []}");
  reader.finish();
  return sweep;
}

std::vector<SweepRun> runs_of(const SweepConfig& sweep) {
  std::vector<SweepRun> runs;
  for (const auto& variant : sweep.runs)
    for (const std::uint64_t seed : sweep.seeds) {
      SweepRun run{.variant = variant.name, .seed = seed, .folder = {}, .overrides = sweep.set, .config = {}};
      run.folder = std::filesystem::path(sweep.out) / variant.name / fmt::format("seed_{}", seed);
      run.overrides.insert(run.overrides.end(), variant.overrides.begin(), variant.overrides.end());
      run.overrides.push_back(fmt::format("seed={}", seed));
      run.overrides.push_back("out=" + run.folder.string());
      run.config = load_run_config(sweep.config, run.overrides);
      if (sweep.evaluate) {
        auto overrides = run.overrides;
        overrides.insert(overrides.end(), sweep.evaluate->begin(), sweep.evaluate->end());
        run.evaluated = load_run_config(sweep.config, overrides);
        if (run.evaluated.eval.file.empty())
          throw InputError(sweep.config, "has no data.eval.file, so runs cannot be evaluated",
                           "remove `evaluate` from the sweep, or set data.eval.file in the config");
      }
      runs.push_back(std::move(run));
    }
  return runs;
}

}  // namespace earshot
