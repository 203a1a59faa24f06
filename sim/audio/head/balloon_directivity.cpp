// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "sim/audio/head/directivity.h"
#include "sim/base/regular_file.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

constexpr std::size_t kMaxFileBytes = std::size_t{64} << 20;
constexpr double kMaxDb = 200.0;

/// Where a value lies between two entries of a rising list.
struct Place {
  std::size_t low, high;
  double weight;  ///< of high
};

Place place_in(const std::vector<double>& list, double value) {
  if (value <= list.front()) return {0, 0, 0.0};
  if (value >= list.back()) return {list.size() - 1, list.size() - 1, 0.0};
  const auto high = static_cast<std::size_t>(std::upper_bound(list.begin(), list.end(), value) - list.begin());
  return {high - 1, high, (value - list[high - 1]) / (list[high] - list[high - 1])};
}

class Balloon final : public Directivity {
 public:
  Balloon(std::vector<double> log_frequency, std::vector<double> elevation_deg, std::vector<double> azimuth_deg,
          std::vector<double> gain_db)
      : log_frequency_(std::move(log_frequency)),
        elevation_(std::move(elevation_deg)),
        azimuth_(std::move(azimuth_deg)),
        gain_db_(std::move(gain_db)) {
    close_poles();
    for (std::size_t f = 0; f < log_frequency_.size(); ++f) {
      const double front = level_db(f, 0.0, 0.0);
      for (std::size_t i = 0; i < elevation_.size() * azimuth_.size(); ++i) gain_db_[f * elevation_.size() * azimuth_.size() + i] -= front;
    }
  }

  [[nodiscard]] float pressure(glm::vec3 direction, float frequency_hz) const override {
    constexpr double degrees = 180.0 / std::numbers::pi;
    const double elevation = std::atan2(direction.y, std::hypot(direction.x, direction.z)) * degrees;
    const double azimuth = std::atan2(-direction.x, -direction.z) * degrees;
    const Place f = place_in(log_frequency_, std::log(std::max(static_cast<double>(frequency_hz), 1e-3)));
    const double low = level_db(f.low, elevation, azimuth), high = f.high == f.low ? low : level_db(f.high, elevation, azimuth);
    return static_cast<float>(std::pow(10.0, (low + f.weight * (high - low)) / 20.0));
  }

 private:
  [[nodiscard]] double& at(std::size_t f, std::size_t e, std::size_t a) {
    return gain_db_[(f * elevation_.size() + e) * azimuth_.size() + a];
  }
  [[nodiscard]] double at(std::size_t f, std::size_t e, std::size_t a) const {
    return gain_db_[(f * elevation_.size() + e) * azimuth_.size() + a];
  }

  /// Makes a row at each pole with one value: the mean power of the row that is there or nearest.
  void close_poles() {
    const bool add_bottom = elevation_.front() > -90.0, add_top = elevation_.back() < 90.0;
    const std::size_t columns = azimuth_.size(), rows = elevation_.size();
    std::vector<double> closed;
    for (std::size_t f = 0; f < log_frequency_.size(); ++f) {
      const auto add_mean_of = [&](std::size_t row) {
        double power = 0;
        for (std::size_t a = 0; a < columns; ++a) power += std::pow(10.0, at(f, row, a) / 10.0) / static_cast<double>(columns);
        closed.insert(closed.end(), columns, 10.0 * std::log10(power));
      };
      add_mean_of(0);
      for (std::size_t e = add_bottom ? 0 : 1; e < (add_top ? rows : rows - 1); ++e)
        for (std::size_t a = 0; a < columns; ++a) closed.push_back(at(f, e, a));
      add_mean_of(rows - 1);
    }
    if (add_bottom) elevation_.insert(elevation_.begin(), -90.0);
    if (add_top) elevation_.push_back(90.0);
    gain_db_ = std::move(closed);
  }

  [[nodiscard]] double level_db(std::size_t f, double elevation_deg, double azimuth_deg) const {
    const Place row = place_in(elevation_, elevation_deg);
    // Around the circle, the last azimuth is followed by the first.
    double azimuth = std::fmod(azimuth_deg - azimuth_.front(), 360.0);
    azimuth = azimuth_.front() + (azimuth < 0 ? azimuth + 360.0 : azimuth);
    Place column = place_in(azimuth_, azimuth);
    if (column.low + 1 == azimuth_.size()) {
      const double gap = azimuth_.front() + 360.0 - azimuth_.back();
      column = {azimuth_.size() - 1, 0, gap > 0 ? std::clamp((azimuth - azimuth_.back()) / gap, 0.0, 1.0) : 0.0};
    }
    const auto along = [&](std::size_t e) {
      const double first = at(f, e, column.low);
      return first + column.weight * (at(f, e, column.high) - first);
    };
    const double low = along(row.low);
    return row.high == row.low ? low : low + row.weight * (along(row.high) - low);
  }

  std::vector<double> log_frequency_, elevation_, azimuth_;  ///< angles in degrees
  std::vector<double> gain_db_;                              ///< [frequency][elevation][azimuth]
};

/// A balloon as its file has it.
struct BalloonTable {
  std::string name, source;
  std::vector<double> frequency_hz, elevation_deg, azimuth_deg;
  std::vector<std::vector<std::vector<double>>> gain_db;
};

void read(ConfigReader& reader, BalloonTable& table) {
  reader.read("name", table.name, "Name of the balloon, free text.");
  reader.read("source", table.source, "Origin of the data, free text.");
  reader.read_required("frequencies_hz", table.frequency_hz, Allowed::between(1, 1e6), "Frequencies [F], rising.");
  reader.read_required("elevations_deg", table.elevation_deg, Allowed::between(-90, 90), "Elevations [E], rising.");
  reader.read_required("azimuths_deg", table.azimuth_deg, Allowed::between(-360, 360),
                       "Azimuths [A], rising within one turn, counter-clockwise from the front seen from above.");
  reader.read_required("gains_db", table.gain_db, Allowed::any(), "Gains [F][E][A], relative to any level, from -200 to 200 dB.");
}

void require_rising(const ConfigReader& reader, const std::string& key, const std::vector<double>& list) {
  if (list.empty()) reader.fail(key, "is empty");
  for (std::size_t i = 1; i < list.size(); ++i)
    if (!(list[i] > list[i - 1])) reader.fail(key, fmt::format("is not increasing at {}", list[i]));
}

std::shared_ptr<const Directivity> read_balloon(ConfigReader reader) {
  BalloonTable table;
  read(reader, table);
  reader.finish();
  std::vector<double>&frequency = table.frequency_hz, &elevation = table.elevation_deg, &azimuth = table.azimuth_deg;
  const auto& nested = table.gain_db;
  require_rising(reader, "frequencies_hz", frequency);
  require_rising(reader, "elevations_deg", elevation);
  require_rising(reader, "azimuths_deg", azimuth);
  if (azimuth.back() - azimuth.front() >= 360.0)
    reader.fail("azimuths_deg", "covers more than a full circle: leave out the last angle, which repeats the first");
  std::vector<double> gain_db;
  gain_db.reserve(frequency.size() * elevation.size() * azimuth.size());
  if (nested.size() != frequency.size())
    reader.fail("gains_db", fmt::format("has {} frequencies instead of {}", nested.size(), frequency.size()));
  for (const auto& rows : nested) {
    if (rows.size() != elevation.size())
      reader.fail("gains_db", fmt::format("has {} elevations instead of {}", rows.size(), elevation.size()));
    for (const auto& row : rows) {
      if (row.size() != azimuth.size()) reader.fail("gains_db", fmt::format("has {} azimuths instead of {}", row.size(), azimuth.size()));
      for (const double value : row) {
        if (!(std::abs(value) <= kMaxDb)) reader.fail("gains_db", fmt::format("{} is outside [-{}, {}] dB", value, kMaxDb, kMaxDb));
        gain_db.push_back(value);
      }
    }
  }
  for (double& value : frequency) value = std::log(value);
  return std::make_shared<const Balloon>(std::move(frequency), std::move(elevation), std::move(azimuth), std::move(gain_db));
}

}  // namespace

std::vector<ConfigKey> Directivity::balloon_keys() {
  ConfigReader describer = ConfigReader::describer();
  BalloonTable table;
  read(describer, table);
  return describer.described();
}

std::shared_ptr<const Directivity> Directivity::balloon(const std::filesystem::path& path) {
  return balloon_from_text(read_regular_file(path, kMaxFileBytes), path.string());
}

std::shared_ptr<const Directivity> Directivity::balloon_from_text(std::string_view text, const std::string& where) {
  return read_balloon(ConfigReader::from_text(text, where));
}

}  // namespace earshot
