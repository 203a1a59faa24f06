#pragma once

#include <string>

namespace earshot {

/// Commit of the sources that this engine was built of, `-dirty` behind it if they were changed; "unknown" outside of a repository.
std::string engine_commit();

}  // namespace earshot
