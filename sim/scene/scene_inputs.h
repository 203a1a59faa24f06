// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace earshot {

/// Identity of what load_scene(spec) reads: the text of the SCENE and the bytes of its files, which are the scene YAML, the mesh with the
/// buffers and material libraries that it names, the annotations beside it, the material database and the file of semantic
/// categories.  Of textures name, size and time.  The built-in databases and the generators belong to the program: the caller adds its
/// version.
///
/// nullopt where it cannot be told, as for a file that is missing or a name with escapes: load_scene says what is wrong there, if anything.
/// Reads every file once: about 0.2 ms per MB of a file in memory.  Never throws for what is on the disk.
std::optional<std::uint64_t> hash_of_scene_inputs(const std::string& spec);

/// The files among them that there are, textures included, each once and in order; none for a generated scene.  nullopt as above.
std::optional<std::vector<std::string>> files_of_scene(const std::string& spec);

}  // namespace earshot
