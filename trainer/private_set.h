#pragma once

#include <filesystem>
#include <string>

#include "trainer/benchmark.h"

namespace earshot {

/// A benchmark may name a second test set by the SHA-256 of its file alone (benchmark.private.sha256), which its maintainers keep to
/// themselves: what a policy does there it cannot have been trained for, and the set cannot be chosen after the policies are known.

/// The benchmark with the private set of `file` in the place of its own: what is evaluated or verified by it is so on that set.  Throws
/// InputError: the benchmark names none, the file is another than it names, or no episode set.
Benchmark with_private_set(const Benchmark& benchmark, const std::filesystem::path& file);

/// Looks for scenes and sounds of the training and of the public test set in the private one, as check_splits does; sounds of heard_sounds
/// are let through, and training may have none of held_out_kinds.  benchmark: without the private set.  Throws InputError with the first
/// that is found.
void check_private_split(const Benchmark& benchmark, const EpisodeSet& private_set);

/// Draws a set of the kind of data.eval from secret numbers of the operating system: as many scenes of the same keys, episodes, filter and
/// scenario, each scene and each sound that is not one of heard_sounds with a seed of its own.  Writes it to `file` (mode 0600), checks its
/// split, and returns the SHA-256 of the file.  Throws InputError: the file is there already, or a scene or sound is none that is generated
/// by a seed.
std::string make_private_set(const Benchmark& benchmark, const std::filesystem::path& file);

}  // namespace earshot
