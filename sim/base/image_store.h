#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>

namespace earshot {

struct ImageStoreConfig {
  std::filesystem::path folder;  ///< made when the first image is written
  /// Ending of the file names without the dot: what the images are, and their version.  Programs that read other images pass them over.
  std::string suffix = "image";
  std::uint64_t max_bytes = 0;  ///< of all images in the folder; may be passed by a part in 32 for each process that writes
  /// Called for each damaged file, and once in the life of a store for a folder that cannot be read or written.  Empty: silent.
  std::function<void(const std::string& message)> warn;
};

/// A folder of byte images by key, shared by any number of threads, processes and runs.  A file is written whole under another name, then
/// renamed: of two that write the same key the last one wins, and both are valid.  It is never changed after that, so readers map it: all
/// of them share one copy in memory.  Whoever has an image mapped keeps its bytes when the file is removed or replaced.
///
/// The folder is a help, not a need: nothing found there throws or ends the program.  A file that is damaged, foreign or unreadable counts
/// as missing, one that cannot be written is left out.  Thread-safe.  Expects a file system where rename replaces atomically.
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
  /// Removes an image whose bytes are as they were written and yet of no use, and warns.
  void reject(std::uint64_t key, const std::string& why);

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
