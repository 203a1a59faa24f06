// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sndfile.h>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <string>

namespace earshot {

/// A file in memory for libsndfile, so that the finished bytes can be written atomically.
struct MemoryFile {
  std::string bytes;
  std::size_t position = 0;
};

/// libsndfile's calls on a MemoryFile, which is its user data.
inline SF_VIRTUAL_IO memory_io() {
  SF_VIRTUAL_IO io{};
  io.get_filelen = [](void* user) { return static_cast<sf_count_t>(static_cast<MemoryFile*>(user)->bytes.size()); };
  io.tell = [](void* user) { return static_cast<sf_count_t>(static_cast<MemoryFile*>(user)->position); };
  io.seek = [](sf_count_t offset, int whence, void* user) {
    auto& file = *static_cast<MemoryFile*>(user);
    const auto base = whence == SEEK_SET ? 0 : whence == SEEK_CUR ? file.position : file.bytes.size();
    file.position = static_cast<std::size_t>(static_cast<sf_count_t>(base) + offset);
    return static_cast<sf_count_t>(file.position);
  };
  io.read = [](void* target, sf_count_t count, void* user) {
    auto& file = *static_cast<MemoryFile*>(user);
    const std::size_t available = file.bytes.size() - std::min(file.position, file.bytes.size());
    const std::size_t taken = std::min(available, static_cast<std::size_t>(count));
    std::memcpy(target, file.bytes.data() + file.position, taken);
    file.position += taken;
    return static_cast<sf_count_t>(taken);
  };
  io.write = [](const void* source, sf_count_t count, void* user) {
    auto& file = *static_cast<MemoryFile*>(user);
    const auto size = static_cast<std::size_t>(count);
    if (file.bytes.size() < file.position + size) file.bytes.resize(file.position + size);
    std::memcpy(file.bytes.data() + file.position, source, size);
    file.position += size;
    return count;
  };
  return io;
}

}  // namespace earshot
