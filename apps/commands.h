// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace earshot {

/// Each adds one sub-command with its help; the callback does the work and throws InputError (exit 2) or RunError (exit 1).
void add_doctor(CLI::App& app);
void add_scene(CLI::App& app);
void add_materials(CLI::App& app);
void add_rir(CLI::App& app);
void add_measure(CLI::App& app);
void add_validate(CLI::App& app);
void add_fit_materials(CLI::App& app);
void add_render(CLI::App& app);
void add_walk(CLI::App& app);
void add_dataset(CLI::App& app);
void add_dataset_rir(CLI::App& dataset);       ///< `dataset rir`
void add_dataset_convolve(CLI::App& dataset);  ///< `dataset convolve`
void add_dataset_pano(CLI::App& dataset);      ///< `dataset pano`
void add_dataset_grid(CLI::App& dataset);      ///< `dataset grid`
void add_dataset_scenes(CLI::App& dataset);    ///< `dataset scenes`
void add_train(CLI::App& app, const std::vector<std::string>& arguments, int& exit_code);
void add_plan(CLI::App& app);
void add_keys(CLI::App& app);
void add_config(CLI::App& app);
void add_policy(CLI::App& app);
void add_leaderboard(CLI::App& app);
void add_replay(CLI::App& app);
void add_bench(CLI::App& app, const std::vector<std::string>& arguments, int& exit_code);
void add_bench_bits(CLI::App& bench);                                                                  ///< `bench bits`
void add_bench_train(CLI::App& bench);                                                                 ///< `bench train`
void add_bench_allreduce(CLI::App& bench, const std::vector<std::string>& arguments, int& exit_code);  ///< `bench allreduce`
void add_bench_scaling(CLI::App& bench, const std::vector<std::string>& arguments, int& exit_code);    ///< `bench scaling`

}  // namespace earshot
