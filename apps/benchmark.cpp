#include "trainer/benchmark.h"

#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>

#include "apps/board_commands.h"
#include "sim/base/files.h"

namespace earshot {

void add_benchmark(CLI::App& app) {
  auto file = std::make_shared<std::string>(), json = std::make_shared<std::string>();
  CLI::App* command =
      app.add_subcommand("benchmark", "Check a benchmark: its rules, its test set, and that training and test have nothing in common");
  command->add_option("BENCHMARK", *file, "File of configs/benchmarks")->required();
  command->add_option("--json", *json, "Also write what was found to a file");
  command->footer("Makes the test set (data.eval.file) if it is missing, and refuses one whose hash is not that of the benchmark.");
  command->callback([file, json] {
    const Benchmark benchmark = load_benchmark(*file);
    check_splits(benchmark);
    const EpisodeSet set = benchmark_set(benchmark);
    fmt::print("{} {}: {} episodes in {}, set {}, rules {}; no scene or sound of the training in it\n", benchmark.name, benchmark.version,
               set.episodes.size(), benchmark.run.eval.file, hex64(set.hash), benchmark.rules_hash);
    const nlohmann::ordered_json report{{"schema_version", 1},
                                        {"benchmark", benchmark.name},
                                        {"version", benchmark.version},
                                        {"episodes_file", benchmark.run.eval.file},
                                        {"episodes", set.episodes.size()},
                                        {"set_hash", hex64(set.hash)},
                                        {"rules_hash", benchmark.rules_hash},
                                        {"seed", benchmark.seed}};
    if (!json->empty()) write_file_atomically(*json, report.dump(2) + "\n");
  });
}

}  // namespace earshot
