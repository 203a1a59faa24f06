// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "sim/base/file_lock.h"

namespace earshot {

struct ImageStoreConfig {
  std::filesystem::path folder;  ///< made when the first image is written
  /// Ending of the file names without the dot: kind and version of the images.  A store with another suffix skips them.
  std::string suffix = "image";
  std::uint64_t max_bytes = 0;  ///< of all images in the folder; each process that writes may exceed it by 1/32
  /// Called for each damaged file, and once in the life of a store for a folder that cannot be read or written.  Empty: silent.
  std::function<void(const std::string& message)> warn;
};

/// A folder of byte images by key, shared by any number of threads, processes and runs.  A file is written whole under another name, then
/// renamed: of two writers of one key the last one wins, and both files are valid.  A file does not change after that, so readers map it:
/// all of them share one copy in memory.  A mapped image keeps its bytes when the file is removed or replaced.
///
/// The folder is optional: no content of it throws or ends the program.  A file that is damaged, of another kind or unreadable counts as
/// missing; one that cannot be written is skipped.  Thread-safe.  Expects a file system where rename replaces atomically.
class ImageStore {
 public:
  struct Image {
    std::span<const std::byte> bytes;   ///< at a multiple of 64 bytes
    std::shared_ptr<const void> owner;  ///< keeps `bytes`
  };

  explicit ImageStore(ImageStoreConfig config);

  /// The image of `key`, its hash checked (reads every byte: about 0.1 ms per MB); nullopt if there is none.  Marks it as used now.
  [[nodiscard]] std::optional<Image> load(std::uint64_t key);
  /// Writes the image, then removes the least recently used ones over the bound.  False if it cannot be written or is over the bound alone.
  bool save(std::uint64_t key, std::span<const std::byte> image);
  /// Removes an image with a valid hash and unusable content, and warns.
  void reject(std::uint64_t key, const std::string& why);

  /// Waits until no other process or thread makes the image of `key`, then blocks them as long as the result lives: the holder loads once
  /// more, and makes the image if it is still missing.  nullopt, and the caller goes on without, if the folder cannot be written or
  /// another one takes longer than `patience`.
  [[nodiscard]] std::optional<FileLock> claim(std::uint64_t key, std::chrono::milliseconds patience);

  [[nodiscard]] std::filesystem::path path_of(std::uint64_t key) const;

 private:
  void remove_over_the_bound(const std::filesystem::path& keep);
  void warn(const std::string& message) const;
  void warn_once(const std::string& message);

  ImageStoreConfig config_;
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace earshot
