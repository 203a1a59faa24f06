#include "evaluation/leaderboard/sweep.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <set>

#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

std::uint64_t seed_of(ConfigReader& reader, const std::string& text) {
  std::uint64_t seed = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), seed);
  if (error != std::errc() || end != text.data() + text.size()) reader.fail("seeds", "'" + text + "' is not a whole number of at least 0");
  return seed;
}

bool is_plain(const std::string& name) {
  return !name.empty() && name.front() != '.' && std::ranges::all_of(name, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-' || c == '.';
  });
}

/// Seeds and folders belong to the sweep.
void refuse_own_keys(ConfigReader& reader, const std::string& key, const std::vector<std::string>& overrides) {
  for (const std::string& override : overrides)
    for (const char* own : {"seed", "out"})
      if (override.starts_with(std::string(own) + "="))
        reader.fail(key, fmt::format("sets '{}', which the sweep sets itself for each run", own));
}

}  // namespace

SweepConfig load_sweep(const std::filesystem::path& path) {
  ConfigReader reader = ConfigReader::from_file(path);
  SweepConfig sweep{.name = path.stem().string(), .out = {}, .config = {}, .seeds = {}, .runs = {}};
  reader.read("name", sweep.name);
  sweep.out = "runs/sweeps/" + sweep.name;
  reader.read("out", sweep.out);
  reader.read_required("config", sweep.config);
  std::vector<std::string> seeds;
  reader.read_required("seeds", seeds);
  for (const std::string& text : seeds) sweep.seeds.push_back(seed_of(reader, text));
  if (sweep.seeds.empty()) reader.fail("seeds", "is empty: give at least one seed");
  if (std::set<std::uint64_t>(sweep.seeds.begin(), sweep.seeds.end()).size() != sweep.seeds.size())
    reader.fail("seeds", "contains a seed twice, which would repeat the run");
  reader.read("set", sweep.set);
  refuse_own_keys(reader, "set", sweep.set);
  ConfigReader runs = reader.child("runs");
  for (const std::string& name : runs.keys()) {
    if (!is_plain(name)) runs.fail(name, "is not a valid run name: use letters, digits, '_', '-' and '.', because it becomes a folder");
    SweepConfig::Variant variant{.name = name, .overrides = {}};
    if (!runs.list_size(name)) runs.fail(name, "is not a list of key=value: write [] for the unchanged config");
    runs.read(name, variant.overrides);
    refuse_own_keys(runs, name, variant.overrides);
    sweep.runs.push_back(std::move(variant));
  }
  if (reader.has("evaluate")) {
    if (!reader.list_size("evaluate")) reader.fail("evaluate", "is not a list of key=value: write [] to evaluate as trained");
    reader.read("evaluate", sweep.evaluate.emplace());
    refuse_own_keys(reader, "evaluate", *sweep.evaluate);
  }
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
