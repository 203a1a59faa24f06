// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "evaluation/leaderboard/benchmark.h"

namespace earshot {

/// A benchmark may name a second test set by a SHA-256 alone (benchmark.private.sha256: digest_of_set, of all that it names), which its
/// maintainers keep to themselves: what a policy does there it cannot have been trained for, and the set cannot be chosen after the
/// policies are known.

/// The benchmark with the private set of `file` instead of its public one, for evaluation and verification.  Throws
/// InputError: the benchmark names none, the file is another than it names, or no episode set.
Benchmark with_private_set(const Benchmark& benchmark, const std::filesystem::path& file);

/// Looks for scenes and sounds of the training and of the public test set in the private one, as check_splits does; sounds of heard_sounds
/// are let through, and training may have none of held_out_kinds.  benchmark: without the private set.  Throws InputError with the first
/// that is found.
void check_private_split(const Benchmark& benchmark, const EpisodeSet& private_set);

/// Numbers that cannot be known to others.
using SecretSeeds = std::function<std::uint64_t()>;
/// One from the operating system, at least a thousand million: beyond what configs are written with.  Throws RunError if it gives none.
std::uint64_t secret_seed();

/// Draws a set of the kind of data.eval from secret numbers of the operating system: as many scenes of the same keys, episodes, filter and
/// scenario, each scene and each sound that is not one of heard_sounds with a seed of its own.  A scene without a floor plan or with too
/// few places, or that the training or public test set has too, is drawn again, up to 20 times.  Checks the split, writes the set to
/// `file`, readable by its owner only, and returns the SHA-256 of the file.  Throws InputError: the file exists, a scene or sound is not
/// generated from a seed, none of 20 draws is valid; then nothing is left behind.
std::string make_private_set(const Benchmark& benchmark, const std::filesystem::path& file, const SecretSeeds& draw = secret_seed);

}  // namespace earshot
