// SPDX-License-Identifier: Apache-2.0
#include "datasets/inputs/wished_rooms.h"

#include <fmt/format.h>

#include <algorithm>

#include "datasets/inputs/wished_responses.h"
#include "datasets/labels/response_labels.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/paths/early_reflections.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

constexpr std::size_t kTenths = WishedResponses::kParts;
constexpr std::uint32_t kMostShoeboxes = 300, kMostScenes = 50;
/// In the place of the scene in the streams of episodes: turns of the listeners of a corpus.
constexpr std::uint32_t kTurnStream = 0x52495454u;

/// 0 within the tenth, none outside the range.
std::optional<double> miss_of(std::optional<double> value, const std::vector<float>& range, std::size_t tenth) {
  const auto low = static_cast<double>(range[0]), high = static_cast<double>(range[1]), part = (high - low) / kTenths;
  if (!value || *value < low || *value > high) return std::nullopt;
  const double from = low + static_cast<double>(tenth) * part;
  return std::max({0.0, from - *value, *value - (from + part)});
}

std::string shown(const std::vector<float>& range) { return fmt::format("[{:g}, {:g}]", range[0], range[1]); }

/// At the first listener of the first source.
std::optional<double> first_t20_s(const CorpusRoom& room) {
  const CorpusSource source = room.draw_source(0);
  const EarlyCandidates candidates(room.acoustics(), source.sound);
  EnergyResponse response;
  compute_energy_response(room.acoustics(), candidates, room.draw_listener(source, 0, 0).position, response);
  return mid_t20_s(measure(room.acoustics(), response));
}

}  // namespace

std::optional<double> WishedDraw::judge(std::optional<double> miss) {
  if (miss && (!best_ || *miss < least_)) {
    best_ = drawn_;
    least_ = *miss;
  }
  ++drawn_;
  return miss;
}

WishedListener::WishedListener(const RirCorpusConfig& config, std::size_t room, int source, int listener) : config_(config) {
  const RandomStream random{config.seed, Purpose::episode, kTurnStream, static_cast<std::uint32_t>(room),
                            static_cast<std::uint32_t>(source)};
  tenth_ = (random.below(kTenths, 0) + static_cast<std::size_t>(listener)) % kTenths;
}

bool WishedListener::is_asked() const { return !config_.shared_listeners && (is_range(config_.rt60_s) || is_range(config_.drr_db)); }

std::optional<double> WishedListener::miss(const AcousticScene& acoustics, const EnergyResponse& response) const {
  const RoomMetrics metrics = measure(acoustics, response);
  if (is_range(config_.rt60_s)) {
    const std::optional<double> t20_s = mid_t20_s(metrics);
    if (!t20_s || *t20_s < static_cast<double>(config_.rt60_s[0]) || *t20_s > static_cast<double>(config_.rt60_s[1])) return std::nullopt;
  }
  return is_range(config_.drr_db) ? miss_of(metrics.drr_db, config_.drr_db, tenth_) : 0.0;
}

std::string WishedListener::text() const {
  std::string text;
  if (is_range(config_.rt60_s)) text = "rt60_s in " + shown(config_.rt60_s);
  if (is_range(config_.drr_db)) text += (text.empty() ? "drr_db in " : " and drr_db in ") + shown(config_.drr_db);
  return text;
}

std::shared_ptr<const CorpusRoom> load_wished_room(const RirCorpusConfig& config, std::size_t index, const CorpusRoomSpec& spec) {
  const auto load = [&](std::uint32_t redraw) {
    return std::make_shared<const CorpusRoom>(config, index, redraw == 0 ? spec : redraw_room(config, index, spec, redraw));
  };
  if (!is_range(config.rt60_s)) return load(0);
  const std::uint32_t most = index < static_cast<std::size_t>(config.shoeboxes.count) ? kMostShoeboxes : kMostScenes;
  WishedDraw draw;
  while (draw.wants_more(most)) {
    std::shared_ptr<const CorpusRoom> room = load(draw.next());
    if (draw.judge(miss_of(first_t20_s(*room), config.rt60_s, index % kTenths)) == 0) return room;
  }
  if (!draw.best())
    throw InputError(spec.scene,
                     fmt::format("reaches no rt60_s in {} in {} draws of its {}", shown(config.rt60_s), most,
                                 most == kMostShoeboxes ? "shape" : "materials"),
                     "widen the range, or change the sizes, absorption or materials");
  return load(*draw.best());
}

}  // namespace earshot
