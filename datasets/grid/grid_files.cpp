// SPDX-License-Identifier: Apache-2.0
#include "datasets/grid/grid_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <nlohmann/json.hpp>

#include "datasets/grid/array_files.h"
#include "sim/audio/dry_sounds/sound_file.h"
#include "sim/base/errors.h"
#include "sim/base/text/json.h"

namespace earshot {
namespace {

/// Of a chunk of an array: what a reader of one response reads, and a file of the scene.
constexpr std::size_t kMaxChunkBytes = std::size_t{4} << 20;
constexpr std::uint64_t kBlockBytes = 4096, kWavHeaderBytes = 128;
/// Of a line of the manifest, at most: the labels, and what the name of a file has after its folder, with quotes and comma.
constexpr std::uint64_t kLabelBytes = 700, kFileNameBytes = 24;

std::string array_folder(const GridFileSizes& sizes) { return sizes.folder + "/responses.zarr"; }

std::size_t samples_of_pair(const GridFileSizes& sizes) { return sizes.num_azimuths() * sizes.num_channels * sizes.num_samples; }

std::size_t receivers_per_chunk(const GridFileSizes& sizes) {
  return std::clamp<std::size_t>(kMaxChunkBytes / (samples_of_pair(sizes) * sizeof(float)), 1, sizes.num_points);
}

class WavFiles final : public GridSourceFiles {
 public:
  WavFiles(const GridFileSizes& sizes, std::size_t source) : sizes_(sizes), source_(source) {}

  void add(std::size_t receiver, std::size_t azimuth, const Rir& rir, CorpusPieceWriter& writer) override {
    const std::string name = name_of(receiver, azimuth);
    writer.write(name, encode_sound(rir.samples, rir.num_channels, rir.sample_rate_hz, SoundFormat::wav, name, rir.channel_mask));
  }
  void label(std::size_t receiver, nlohmann::ordered_json& line) const override {
    for (std::size_t azimuth = 0; azimuth < sizes_.num_azimuths(); ++azimuth) line["files"].push_back(name_of(receiver, azimuth));
  }

 private:
  [[nodiscard]] std::string name_of(std::size_t receiver, std::size_t azimuth) const {
    const std::string of_azimuth = sizes_.has_azimuths ? fmt::format("{}/", kGridAzimuths[azimuth]) : std::string();
    return fmt::format("{}/{}{}_{}.wav", sizes_.folder, of_azimuth, receiver, source_);
  }

  const GridFileSizes& sizes_;
  std::size_t source_;
};

class ZarrChunks final : public GridSourceFiles {
 public:
  ZarrChunks(const GridFileSizes& sizes, std::size_t source)
      : sizes_(sizes), source_(source), receivers_(receivers_per_chunk(sizes)), chunk_(receivers_ * samples_of_pair(sizes)) {}

  void add(std::size_t receiver, std::size_t azimuth, const Rir& rir, CorpusPieceWriter& writer) override {
    const std::size_t of_response = sizes_.num_channels * sizes_.num_samples;
    EARSHOT_EXPECT(rir.samples.size() == of_response);
    if (receiver % receivers_ == 0 && azimuth == 0) std::ranges::fill(chunk_, 0.f);
    const std::size_t at = receiver % receivers_ * samples_of_pair(sizes_) + azimuth * of_response;
    std::ranges::copy(rir.samples, chunk_.begin() + static_cast<std::ptrdiff_t>(at));
    const bool is_last = receiver + 1 == sizes_.num_points || (receiver + 1) % receivers_ == 0;
    if (!is_last || azimuth + 1 < sizes_.num_azimuths()) return;
    bytes_.resize(chunk_.size() * sizeof(float));
    std::memcpy(bytes_.data(), chunk_.data(), bytes_.size());
    const char* const rest = sizes_.has_azimuths ? "0.0.0" : "0.0";
    writer.write(fmt::format("{}/{}.{}.{}", array_folder(sizes_), source_, receiver / receivers_, rest), bytes_);
  }
  void label(std::size_t, nlohmann::ordered_json&) const override {}

 private:
  const GridFileSizes& sizes_;
  std::size_t source_, receivers_;
  std::vector<float> chunk_;
  std::string bytes_;
};

}  // namespace

std::unique_ptr<GridSourceFiles> GridFiles::of_source(std::size_t source) const {
  if (sizes_.format == GridFormat::wav) return std::make_unique<WavFiles>(sizes_, source);
  return std::make_unique<ZarrChunks>(sizes_, source);
}

std::vector<CorpusFile> GridFiles::index() const {
  if (sizes_.format == GridFormat::wav) return {};
  std::vector<std::size_t> shape{sizes_.num_points, sizes_.num_points}, chunks{1, receivers_per_chunk(sizes_)};
  nlohmann::ordered_json attributes{{"_ARRAY_DIMENSIONS", {"source", "receiver"}}};
  if (sizes_.has_azimuths) {
    shape.push_back(std::size(kGridAzimuths));
    attributes["_ARRAY_DIMENSIONS"].push_back("azimuth");
    attributes["azimuth_deg"] = kGridAzimuths;
  }
  shape.insert(shape.end(), {sizes_.num_channels, sizes_.num_samples});
  chunks.insert(chunks.end(), shape.begin() + 2, shape.end());
  for (const char* name : {"channel", "sample"}) attributes["_ARRAY_DIMENSIONS"].push_back(name);
  attributes["sample_rate_hz"] = sizes_.sample_rate_hz;
  return {{array_folder(sizes_) + "/.zattrs", json_text(attributes, 1) + "\n"},
          {array_folder(sizes_) + "/.zarray", json_text(zarr_array(kFloat32, shape, chunks), 1) + "\n"}};
}

std::uint64_t GridFiles::bytes_of_source() const {
  const auto in_blocks = [](std::uint64_t bytes) { return (bytes + kBlockBytes - 1) / kBlockBytes * kBlockBytes; };
  const std::uint64_t names = sizes_.format == GridFormat::wav ? sizes_.num_azimuths() * (sizes_.folder.size() + kFileNameBytes) : 0,
                      lines = 2 * sizes_.num_points * (kLabelBytes + names);
  if (sizes_.format == GridFormat::wav)
    return lines + sizes_.num_points * sizes_.num_azimuths() *
                       in_blocks(kWavHeaderBytes + sizes_.num_channels * sizes_.num_samples * sizeof(float));
  const std::size_t receivers = receivers_per_chunk(sizes_);
  return lines + (sizes_.num_points + receivers - 1) / receivers * in_blocks(receivers * samples_of_pair(sizes_) * sizeof(float));
}

}  // namespace earshot
