// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/measured/clf_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>

#include "sim/base/errors.h"
#include "sim/base/text/config_number.h"
#include "sim/base/text/text_match.h"

namespace earshot {
namespace {

constexpr double kMaxLevelDb = 300.0, kPoleDb = 1.0, kMostAsymmetry = 0.12;
constexpr std::string_view kClfRemedy = "use CLF1 or CLF2 text of version 1";

/// Fields of a line between tabs, without blanks around them; a field that starts with # ends the line.
std::vector<std::string_view> fields_of(std::string_view line) {
  std::vector<std::string_view> fields;
  while (!line.empty()) {
    const std::size_t tab = std::min(line.find('\t'), line.size());
    std::string_view field = line.substr(0, tab);
    line.remove_prefix(std::min(tab + 1, line.size()));
    const std::size_t first = field.find_first_not_of(" \r\v\f");
    if (first == std::string_view::npos) continue;
    field = field.substr(first, field.find_last_not_of(" \r\v\f") - first + 1);
    if (field.front() == '#') break;
    fields.push_back(field);
  }
  return fields;
}

std::string shown(std::string_view text) {
  std::string safe;
  for (const char c : text.substr(0, 40)) safe += c >= ' ' && c <= '~' ? c : '?';
  return safe;
}

class ClfParser {
 public:
  explicit ClfParser(std::string where) : where_(std::move(where)) {}

  ClfBalloon parse(std::string_view text) {
    if (text.find('\0') != std::string_view::npos)
      throw InputError(where_, "is a binary CLF file (CF1, CF2), whose layout is not public", std::string(kClfRemedy));
    if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);
    for (std::size_t at = 0; at < text.size() && !is_over_; ++line_) {
      const std::size_t end = std::min(text.find('\n', at), text.size());
      read_line(fields_of(text.substr(at, end - at)));
      at = end + 1;
    }
    if (!has_start_) throw refuse("does not start with <CLF1> or <CLF2>");
    if (!is_over_) throw InputError(where_, fmt::format("ends without <{}END>; it is cut short", kind()), "use the whole file");
    if (balloon_.frequency_hz.empty()) throw refuse("has no <BAND>");
    return std::move(balloon_);
  }

 private:
  [[nodiscard]] InputError refuse(const std::string& problem) const { return {where_, problem, std::string(kClfRemedy)}; }
  [[nodiscard]] InputError refuse_line(const std::string& problem) const {
    return {fmt::format("{}:{}", where_, line_), problem, std::string(kClfRemedy)};
  }

  [[nodiscard]] const char* kind() const { return balloon_.step_deg == 10 ? "CLF1" : "CLF2"; }

  void read_line(const std::vector<std::string_view>& fields) {
    if (fields.empty()) return;
    const std::string tag = fold_case(fields[0]);
    if (!has_start_) {
      if (tag != "<clf1>" && tag != "<clf2>") throw refuse_line(fmt::format("'{}' is not <CLF1> or <CLF2>", shown(fields[0])));
      balloon_.step_deg = tag == "<clf1>" ? 10 : 5;
      has_start_ = true;
    } else if (in_band_ && tag == "<nodata>") {
      throw refuse_line("<nodata>: what is radiated there is not known");
    } else if (tag.starts_with('<')) {
      end_band();
      read_tag(tag, fields);
    } else if (in_band_) {
      read_row(fields);
    }
  }

  void read_tag(const std::string& tag, const std::vector<std::string_view>& fields) {
    const std::string value = fields.size() > 1 ? fold_case(fields[1]) : "";
    const auto unclear = [&] { return refuse_line(fmt::format("{} {}: no public description fixes it", shown(fields[0]), shown(value))); };
    if (tag == "<band>") {
      begin_band(value);
    } else if (tag == "<clf1end>" || tag == "<clf2end>") {
      if (tag != fold_case(fmt::format("<{}end>", kind())))
        throw refuse_line(fmt::format("{} ends a file that starts with <{}>", shown(fields[0]), kind()));
      is_over_ = true;
    } else if (tag == "<version>") {
      if (value != "1") throw unclear();
    } else if (tag == "<radiation>") {
      if (value != "<fullsphere>" && value != "fullsphere") throw unclear();
    } else if (tag == "<sign>") {
      if (value != "<actual>" && value != "actual") throw unclear();
    } else if (tag == "<balloon-arc-order>") {
      if (fields.size() > 2 || (value != "<normal>" && value != "<default>" && value != "<reversed>")) throw unclear();
    } else if (tag == "<balloon-symmetry>") {
      if (!balloon_.frequency_hz.empty()) throw refuse_line("<BALLOON-SYMMETRY> stands after a <BAND>");
      const std::size_t whole = 360 / balloon_.step_deg;
      const std::map<std::string, std::size_t> arcs = {
          {"<none>", whole}, {"<horizontal>", whole / 2 + 1}, {"<full>", whole / 4 + 1}, {"<rotational>", 1}};
      const auto found = arcs.find(value);
      if (found == arcs.end()) throw unclear();
      num_rows_ = found->second;
      symmetry_ = value;
    } else if (tag.find("phase") != std::string::npos || tag.find("filter") != std::string::npos || tag.starts_with("<part")) {
      throw refuse_line(fmt::format("{}: no public description fixes it", shown(fields[0])));
    }
  }

  void begin_band(const std::string& value) {
    if (num_rows_ == 0) throw refuse_line("<BAND> stands before <BALLOON-SYMMETRY>");
    const auto frequency = parse_decimal<double>(value);
    if (!frequency || !(*frequency >= 1 && *frequency <= 1e6))
      throw refuse_line(fmt::format("'{}' is not a frequency in Hz", shown(value)));
    if (!balloon_.frequency_hz.empty() && !(*frequency > balloon_.frequency_hz.back()))
      throw refuse_line(fmt::format("the band {} Hz does not rise", *frequency));
    if (balloon_.frequency_hz.size() >= 64) throw refuse_line("has more than 64 bands");
    balloon_.frequency_hz.push_back(*frequency);
    in_band_ = true;
    rows_.clear();
  }

  void read_row(const std::vector<std::string_view>& fields) {
    const std::size_t angles = balloon_.num_angles();
    if (rows_.size() == num_rows_)
      throw refuse_line(
          fmt::format("band {} Hz has more than {} arcs, the number of {}", balloon_.frequency_hz.back(), num_rows_, symmetry_));
    if (fields.size() != angles)
      throw refuse_line(
          fmt::format("has {} levels instead of {}, one per {} degrees from front to back", fields.size(), angles, balloon_.step_deg));
    std::vector<double>& row = rows_.emplace_back();
    for (const std::string_view field : fields) {
      const auto value = parse_decimal<double>(field);
      if (!value) throw refuse_line(fmt::format("'{}' is not a number with a decimal point", shown(field)));
      if (!(std::abs(*value) <= kMaxLevelDb)) throw refuse_line(fmt::format("{} dB is outside [-300, 300]", *value));
      row.push_back(*value);
    }
  }

  void end_band() {
    if (!in_band_) return;
    in_band_ = false;
    const double frequency = balloon_.frequency_hz.back();
    if (rows_.size() != num_rows_)
      throw refuse_line(
          fmt::format("band {} Hz has {} arcs instead of {}, the number of {}", frequency, rows_.size(), num_rows_, symmetry_));
    for (const auto& [angle, name] : {std::pair{std::size_t{0}, "front"}, {balloon_.num_angles() - 1, "back"}}) {
      double lowest = kMaxLevelDb, highest = -kMaxLevelDb;
      for (const std::vector<double>& row : rows_) {
        lowest = std::min(lowest, row[angle]);
        highest = std::max(highest, row[angle]);
      }
      // Behind, a level far below the front is noise.
      if (highest - lowest > kPoleDb && (angle == 0 || highest > rows_[0][0] - 40))
        throw refuse_line(fmt::format("the arcs of band {} Hz meet in {} with levels {:.2f} dB apart; are rows and columns exchanged?",
                                      frequency, name, highest - lowest));
    }
    append_half();
  }

  /// Adds the arcs from up to down: those of the file, mirrored, or the mean power of left and right.
  void append_half() {
    const std::size_t half = 180 / balloon_.step_deg;
    double difference = 0, sum = 0;
    for (std::size_t arc = 0; arc <= half; ++arc) {
      const std::size_t first = num_rows_ == 1 ? 0 : num_rows_ == half / 2 + 1 ? std::min(arc, half - arc) : arc;
      const std::size_t second = num_rows_ == 2 * half ? (2 * half - arc) % (2 * half) : first;
      for (std::size_t angle = 0; angle < balloon_.num_angles(); ++angle) {
        const double a = std::pow(10.0, (rows_[first][angle] - rows_[0][0]) / 20.0);
        const double b = std::pow(10.0, (rows_[second][angle] - rows_[0][0]) / 20.0);
        const double solid = std::sin(std::numbers::pi * static_cast<double>(angle * balloon_.step_deg) / 180.0);
        difference += solid * (a - b) * (a - b);
        sum += solid * 0.5 * (a * a + b * b);
        balloon_.level_db.push_back(first == second ? rows_[first][angle] : rows_[0][0] + 10.0 * std::log10(0.5 * (a * a + b * b)));
      }
    }
    const double asymmetry = sum > 0 ? std::sqrt(difference / sum) : 0.0;
    if (!(asymmetry <= kMostAsymmetry))
      throw refuse_line(fmt::format("left and right of band {} Hz differ by {:.0f} %, and no public description says which is which",
                                    balloon_.frequency_hz.back(), 100 * asymmetry));
    balloon_.asymmetry = std::max(balloon_.asymmetry, asymmetry);
  }

  std::string where_, symmetry_;
  ClfBalloon balloon_;
  std::vector<std::vector<double>> rows_;
  std::size_t line_ = 1, num_rows_ = 0;
  bool has_start_ = false, in_band_ = false, is_over_ = false;
};

}  // namespace

ClfBalloon parse_clf(std::string_view text, const std::string& where) { return ClfParser(where).parse(text); }

}  // namespace earshot
