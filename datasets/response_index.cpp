// SPDX-License-Identifier: Apache-2.0
#include "datasets/response_index.h"

#include <algorithm>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "datasets/corpus_folder.h"
#include "datasets/measured/measured_index.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"
#include "sim/base/text/schema_version.h"

namespace earshot {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMaxRooms = 100'000'000;
/// Far beyond any room, and small enough that a number of samples fits an integer.
constexpr double kMaxDistanceM = 1e6, kLongestDelayS = 3600;
constexpr float kHighestRateHz = 1e6f;

/// Not a number for null.
double number_of(const Json& json) { return json.is_null() ? std::numeric_limits<double>::quiet_NaN() : json.get<double>(); }

IndexedResponse parse_line(std::string_view line) {
  const Json json = parse_ordered_json(line);
  IndexedResponse response{.id = json.at("id").get<std::string>(),
                           .file = json.at("file").get<std::string>(),
                           .early_file = {},
                           .room = json.at("room").get<std::size_t>(),
                           .source = json.at("source").at("index").get<int>(),
                           .place = {},
                           .distance_m = json.at("distance_m").get<double>(),
                           .direct_delay_s = json.at("direct_delay_s").get<double>(),
                           .gain = json.at("gain").get<double>(),
                           .t20_mid_s = number_of(json.at("t20_mid_s")),
                           .drr_db = number_of(json.at("drr_db")),
                           .labels = {}};
  if (json.contains("early_file") && json.at("early_file").is_string()) response.early_file = json.at("early_file").get<std::string>();
  Json listener = json.at("listener");
  listener.erase("index");
  response.place = json_text(listener);
  Json labels = {{"response", response.id}, {"scene", json.at("scene")}, {"room", response.room}, {"source", response.source}};
  for (const char* key : {"distance_m", "azimuth_deg", "elevation_deg", "line_of_sight", "direct_delay_s", "drr_db", "t20_mid_s"})
    labels[key] = json.at(key);
  response.labels = json_text(labels);
  return response;
}

}  // namespace

ResponseIndex::ResponseIndex(std::filesystem::path corpus) : corpus_(std::move(corpus)) {
  const std::filesystem::path description = corpus_ / "corpus.json", manifest = corpus_ / "manifest.jsonl";
  if (!std::filesystem::exists(description))
    throw InputError(corpus_.string(), "contains no corpus.json",
                     "give a folder written by 'earshot dataset rir', or with --measured one of measured responses");
  if (!std::filesystem::exists(manifest))
    throw InputError(corpus_.string(), "contains an incomplete corpus", "run 'earshot dataset rir' again for all shards");
  const std::string text = read_file(manifest);
  hash_ = hash64(text);
  std::size_t number = 1;
  try {
    const Json json = parse_ordered_json(read_file(description));
    check_schema_version(json, kCorpusVersionKey, description.string(), "a corpus", {1, kCorpusVersion});
    sample_rate_hz_ = json.at("sample_rate_hz").get<float>();
    channels_ = json.at("channels").get<std::vector<std::string>>();
    for (std::size_t begin = 0; begin < text.size(); ++number) {
      const std::size_t end = std::min(text.find('\n', begin), text.size());
      responses_.push_back(parse_line(std::string_view(text).substr(begin, end - begin)));
      begin = end + 1;
    }
  } catch (const nlohmann::json::exception&) {
    throw InputError(manifest.string() + ":" + std::to_string(number), "is not a valid line of a response manifest",
                     "give a folder written by 'earshot dataset rir'");
  }
  if (!(sample_rate_hz_ > 0 && sample_rate_hz_ <= kHighestRateHz))
    throw InputError(description.string(), "has a sample rate outside the valid range", "write the corpus again");
  if (responses_.empty()) throw InputError(manifest.string(), "contains no response", "write the corpus again");
  for (std::size_t i = 0; i < responses_.size(); ++i) {
    const IndexedResponse& response = responses_[i];
    if (response.file.ends_with(".sofa"))
      throw InputError(corpus_.string(), "stores its responses in SOFA files", "write the corpus with format wav or flac");
    const bool in_range = response.room < kMaxRooms && response.gain > 0 && response.distance_m >= 0 &&
                          response.distance_m <= kMaxDistanceM && response.direct_delay_s >= 0 && response.direct_delay_s <= kLongestDelayS;
    if (!in_range)
      throw InputError(manifest.string() + ":" + std::to_string(i + 1), "has a number outside the valid range", "write the corpus again");
  }
  sort_into_rooms();
}

ResponseIndex ResponseIndex::of_measured(std::filesystem::path folder) {
  if (std::filesystem::exists(folder / "corpus.json"))
    throw InputError(folder.string(), "is a corpus of 'earshot dataset rir', not a folder of measured responses", "leave out --measured");
  MeasuredIndex measured = index_measured(folder);
  ResponseIndex index;
  index.corpus_ = std::move(folder);
  index.sample_rate_hz_ = measured.sample_rate_hz;
  index.channels_ = std::move(measured.channels);
  index.hash_ = measured.hash;
  index.responses_ = std::move(measured.responses);
  index.sort_into_rooms();
  return index;
}

void ResponseIndex::sort_into_rooms() {
  for (std::size_t i = 0; i < responses_.size(); ++i) {
    const std::size_t room = responses_[i].room;
    if (room >= rooms_.size()) rooms_.resize(room + 1);
    rooms_[room].push_back(i);
  }
}

const std::vector<std::size_t>& ResponseIndex::room_of(std::size_t response) const { return rooms_[responses_[response].room]; }

std::size_t ResponseIndex::fewest_sources() const {
  std::size_t fewest = responses_.size();
  for (const std::vector<std::size_t>& room : rooms_) {
    if (room.empty()) continue;
    std::set<int> sources;
    for (const std::size_t i : room) sources.insert(responses_[i].source);
    fewest = std::min(fewest, sources.size());
  }
  return fewest;
}

bool ResponseIndex::has_early() const {
  return std::ranges::all_of(responses_, [](const IndexedResponse& response) { return !response.early_file.empty(); });
}

SoundChannels ResponseIndex::load(const IndexedResponse& response, const std::string& file) const {
  SoundChannels sound = load_sound_channels(corpus_ / file);
  if (static_cast<std::size_t>(sound.num_channels) != channels_.size() || sound.sample_rate_hz != sample_rate_hz_)
    throw InputError((corpus_ / file).string(), "has a different number of channels or sample rate than its corpus",
                     "write the corpus again");
  const auto factor = static_cast<float>(1 / response.gain);
  for (float& sample : sound.samples) sample *= factor;
  return sound;
}

}  // namespace earshot
