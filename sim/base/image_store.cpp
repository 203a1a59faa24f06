// SPDX-License-Identifier: Apache-2.0
#include "sim/base/image_store.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <ctime>
#include <mutex>
#include <system_error>
#include <tuple>
#include <utility>
#include <vector>

#include "sim/base/file_descriptor.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

/// First bytes of a file.  Numbers are in native order: on a machine of the other order the magic number does not match.
struct Header {
  static constexpr std::uint64_t kMagic = 0x31474D4948535245;  // "ERSHIMG1" in little-endian order
  std::uint64_t magic = kMagic;
  std::uint64_t key = 0;
  std::uint64_t num_bytes = 0;
  std::uint64_t hash = 0;  ///< of the image, with the key as seed
  std::uint64_t reserved[4] = {};
};
static_assert(sizeof(Header) == 64);  // so that what follows is aligned to a cache line

constexpr auto kStaleTemporary = std::chrono::hours(1);

/// Pages of a file, read-only and shared.
struct Mapping {
  Mapping(int descriptor, std::size_t size)
      : bytes(::mmap(nullptr, size, PROT_READ, MAP_SHARED | MAP_POPULATE, descriptor, 0)), num_bytes(size) {}
  ~Mapping() {
    if (bytes != MAP_FAILED) ::munmap(bytes, num_bytes);
  }
  Mapping(const Mapping&) = delete;
  Mapping& operator=(const Mapping&) = delete;
  void* bytes;
  std::size_t num_bytes;
};

/// Writing past RLIMIT_FSIZE raises SIGXFSZ in the thread that writes, which would end the program; with this it is an error of write().
class NoFileSizeSignal {
 public:
  NoFileSizeSignal() {
    sigemptyset(&signal_);
    sigaddset(&signal_, SIGXFSZ);
    blocked_ = pthread_sigmask(SIG_BLOCK, &signal_, &before_) == 0;
  }
  ~NoFileSizeSignal() {
    if (!blocked_ || sigismember(&before_, SIGXFSZ)) return;
    const timespec at_once{};
    while (sigtimedwait(&signal_, nullptr, &at_once) > 0) {
    }
    pthread_sigmask(SIG_SETMASK, &before_, nullptr);
  }
  NoFileSizeSignal(const NoFileSizeSignal&) = delete;
  NoFileSizeSignal& operator=(const NoFileSizeSignal&) = delete;

 private:
  sigset_t signal_{}, before_{};
  bool blocked_ = false;
};

bool write_all(int descriptor, std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(descriptor, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
  return true;
}

/// A new file in the folder, under a name that no other process uses.  No image has it: it begins with a dot.
std::filesystem::path temporary_in(const std::filesystem::path& folder, std::uint64_t key, std::uint64_t count) {
  const auto now = std::chrono::steady_clock::now().time_since_epoch().count();  // processes of two machines may have one number
  return folder / fmt::format(".{}.{}.{}.{}.tmp", hex64(key), ::getpid(), now, count);
}

/// 16 hexadecimal digits and any ending: images of other versions count to the bound, and are the first to go.
bool is_image(const std::filesystem::path& path) {
  const std::string stem = path.stem().string();
  return stem.size() == 16 && path.has_extension() && stem.find_first_not_of("0123456789abcdef") == std::string::npos;
}

}  // namespace

struct ImageStore::State {
  std::mutex mutex;  // one thread of this process scans the folder at a time
  bool looked_through = false;
  std::uint64_t written_since = 0;
  std::atomic<std::uint64_t> temporaries{0};
  std::atomic<bool> warned{false};
};

ImageStore::ImageStore(ImageStoreConfig config) : config_(std::move(config)), state_(std::make_shared<State>()) {}

std::filesystem::path ImageStore::path_of(std::uint64_t key) const { return config_.folder / (hex64(key) + "." + config_.suffix); }

std::optional<ImageStore::Image> ImageStore::load(std::uint64_t key) {
  const std::filesystem::path path = path_of(key);
  // Not blocking: opening a pipe of this name must return.
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (file.get() < 0) {
    if (errno != ENOENT) warn_once(fmt::format("{} cannot be opened: {}; it is computed again", path.string(), last_error()));
    return std::nullopt;
  }
  const auto damaged = [&](std::string_view problem) {
    warn(fmt::format("{} {} and is computed again", path.string(), problem));
    return std::nullopt;
  };
  struct stat status {};
  if (::fstat(file.get(), &status) != 0 || !S_ISREG(status.st_mode)) return damaged("is not a regular file");
  const auto size = static_cast<std::size_t>(status.st_size);
  if (size <= sizeof(Header)) return damaged("is truncated");
  const auto mapping = std::make_shared<const Mapping>(file.get(), size);
  if (mapping->bytes == MAP_FAILED) {
    warn_once(fmt::format("{} cannot be mapped: {}; it is computed again", path.string(), last_error()));
    return std::nullopt;
  }
  Header header;
  std::memcpy(&header, mapping->bytes, sizeof header);
  if (header.magic != Header::kMagic) return damaged("is a file of another kind");
  if (header.key != key) return damaged("belongs to another key");
  if (header.num_bytes != size - sizeof header) return damaged("is truncated");
  const std::span<const std::byte> bytes(static_cast<const std::byte*>(mapping->bytes) + sizeof header, size - sizeof header);
  if (hash64(bytes, key) != header.hash) return damaged("is corrupted");
  // Both times to now: the least recently used images are removed first.  Fails without effect in a read-only folder.
  static_cast<void>(::futimens(file.get(), nullptr));
  return Image{bytes, mapping};
}

bool ImageStore::save(std::uint64_t key, std::span<const std::byte> image) {
  const Header header{.key = key, .num_bytes = image.size(), .hash = hash64(image, key)};
  if (image.empty() || sizeof header + image.size() > config_.max_bytes) return false;
  std::error_code error;
  std::filesystem::create_directories(config_.folder, error);
  if (error) {
    warn_once(fmt::format("{} cannot be created: {}; nothing is cached there", config_.folder.string(), error.message()));
    return false;
  }
  const std::filesystem::path path = path_of(key), temporary = temporary_in(config_.folder, key, state_->temporaries.fetch_add(1));
  // Not flushed to the disk: after a power failure a torn file has the wrong hash, and is made anew.
  const auto write = [&] {
    const NoFileSizeSignal quiet;
    Descriptor file(::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
    if (file.get() < 0) return false;
    return write_all(file.get(), std::as_bytes(std::span(&header, 1))) && write_all(file.get(), image) && file.close() &&
           ::rename(temporary.c_str(), path.c_str()) == 0;
  };
  if (!write()) {
    const std::string why = last_error();
    ::unlink(temporary.c_str());
    warn_once(fmt::format("{} cannot be written: {}; it is computed again when it is needed", path.string(), why));
    return false;
  }
  const std::scoped_lock lock(state_->mutex);
  state_->written_since += sizeof header + image.size();
  if (!state_->looked_through || state_->written_since > config_.max_bytes / 32) {
    remove_over_the_bound(path);
    state_->looked_through = true;
    state_->written_since = 0;
  }
  return true;
}

std::optional<FileLock> ImageStore::claim(std::uint64_t key, std::chrono::milliseconds patience) {
  std::error_code ignored;  // a folder that cannot be made is one that no lock lies in
  std::filesystem::create_directories(config_.folder, ignored);
  // The ending is that of temporary files: one that a killed process has left goes with those.
  return FileLock::acquire(config_.folder / fmt::format(".{}.lock.tmp", hex64(key)), patience);
}

void ImageStore::reject(std::uint64_t key, const std::string& why) {
  const std::filesystem::path path = path_of(key);
  ::unlink(path.c_str());
  warn(fmt::format("{} cannot be used and is computed again: {}", path.string(), why));
}

void ImageStore::remove_over_the_bound(const std::filesystem::path& keep) {
  struct Found {
    std::filesystem::file_time_type used;
    std::filesystem::path path;
    std::uint64_t bytes;
  };
  std::vector<Found> found;
  std::uint64_t total = 0;
  std::error_code error;
  const auto now = std::filesystem::file_time_type::clock::now();
  // Other processes write and remove at the same time: a file that is gone when it is examined does not count.
  for (std::filesystem::directory_iterator entry(config_.folder, error), end; !error && entry != end; entry.increment(error)) {
    std::error_code gone;
    const auto used = entry->last_write_time(gone);
    const std::uint64_t bytes = gone || !entry->is_regular_file(gone) ? 0 : entry->file_size(gone);
    if (gone) continue;
    const std::filesystem::path& path = entry->path();
    if (path.extension() == ".tmp" && path.filename().string().starts_with('.')) {
      if (now - used > kStaleTemporary) std::filesystem::remove(path, gone);  // of a process that was ended while it wrote
    } else if (is_image(path)) {
      total += bytes;
      if (path != keep) found.push_back({used, path, bytes});
    }
  }
  std::ranges::sort(found, [](const Found& a, const Found& b) { return std::tie(a.used, a.path) < std::tie(b.used, b.path); });
  for (const Found& oldest : found) {
    if (total <= config_.max_bytes) return;
    std::filesystem::remove(oldest.path, error);
    total -= oldest.bytes;
  }
}

void ImageStore::warn(const std::string& message) const {
  if (config_.warn) config_.warn(message);
}

void ImageStore::warn_once(const std::string& message) {
  if (!state_->warned.exchange(true)) warn(message);
}

}  // namespace earshot
