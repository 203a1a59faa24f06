// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "datasets/corpus_folder.h"
#include "datasets/corpus_parts.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"

namespace earshot {

/// wav: one file per response.  zarr: one array per scene.
enum class GridFormat { wav, zarr };

/// Degrees clockwise from -z seen from above: the folders of responses for two ears, and the third axis of an array.
inline constexpr int kGridAzimuths[] = {0, 90, 180, 270};
/// As headings, counter-clockwise.
constexpr double heading_of_azimuth(int azimuth_deg) { return static_cast<double>((360 - azimuth_deg) % 360); }

/// The files of the responses of a grid: where they lie and how long they are.
struct GridFileSizes {
  std::string folder;  ///< of the scene, below that of the corpus
  std::size_t num_points = 0, num_channels = 0, num_samples = 0;
  bool has_azimuths = false;  ///< a response for each of kGridAzimuths, otherwise one
  float sample_rate_hz = 0;
  GridFormat format = GridFormat::wav;
  [[nodiscard]] std::size_t num_azimuths() const { return has_azimuths ? std::size(kGridAzimuths) : 1; }
};

/// Writes the responses of one source, by one thread.
class GridSourceFiles {
 public:
  GridSourceFiles() = default;
  GridSourceFiles(const GridSourceFiles&) = delete;
  GridSourceFiles& operator=(const GridSourceFiles&) = delete;
  virtual ~GridSourceFiles() = default;
  /// Receivers in their order, for each all azimuths in theirs.
  virtual void add(std::size_t receiver, std::size_t azimuth, const Rir& rir, CorpusPieceWriter& writer) = 0;
  /// The names of the files that a receiver has alone, to its line of the manifest.
  virtual void label(std::size_t receiver, nlohmann::ordered_json& line) const = 0;
};

/// Immutable, safe from any thread.
class GridFiles {
 public:
  explicit GridFiles(GridFileSizes sizes) : sizes_(std::move(sizes)) {}
  /// Must not outlive this.
  [[nodiscard]] std::unique_ptr<GridSourceFiles> of_source(std::size_t source) const;
  /// What a complete grid has besides: the description of the array.
  [[nodiscard]] std::vector<CorpusFile> index() const;
  /// On the disk: files in whole blocks, and lines of the manifest, which are there twice.  At least what is written.
  [[nodiscard]] std::uint64_t bytes_of_source() const;

 private:
  GridFileSizes sizes_;
};

}  // namespace earshot
