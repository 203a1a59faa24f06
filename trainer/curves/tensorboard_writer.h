// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

namespace earshot {

/// CRC-32C (Castagnoli; RFC 3720, appendix B.4), as TensorBoard's record format wants it.
std::uint32_t crc32c(std::string_view bytes);
/// Rotated and offset, so that the checksum of data that holds checksums stays good (the record format of TensorFlow,
/// lib/io/record_writer).
std::uint32_t masked_crc32c(std::string_view bytes);

/// Appends scalars to a new events.out.tfevents.* file.  The two protobuf messages that takes (Event, Summary) are encoded by hand.
class TensorBoardWriter {
 public:
  /// Creates the folder.  discard_from_step: tells TensorBoard to forget what older files of this folder say from that step on (a resumed
  /// run). Throws RunError if the file cannot be created.
  explicit TensorBoardWriter(const std::filesystem::path& folder, std::optional<std::int64_t> discard_from_step = std::nullopt);
  ~TensorBoardWriter();
  TensorBoardWriter(const TensorBoardWriter&) = delete;
  TensorBoardWriter& operator=(const TensorBoardWriter&) = delete;

  /// One event of all scalars at `step`; values that are not finite are left out.  Throws RunError (disk full).
  void write(std::int64_t step, std::span<const std::pair<std::string, double>> scalars);
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  void write_record(std::string_view event);

  std::filesystem::path path_;
  int descriptor_ = -1;
};

}  // namespace earshot
