// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <functional>
#include <numbers>
#include <string>
#include <vector>

namespace earshot {

/// CLF text of a balloon in closed form.
struct MadeClf {
  /// Level in dB, of the angle from the front and the one around it from up to one side, both in radians.
  std::function<double(double angle, double around, double frequency_hz)> level_db;
  int step_deg = 10;
  std::vector<double> bands_hz = {125, 250, 500, 1000, 2000, 4000, 8000};
  std::string symmetry = "<none>", extra{};  ///< extra: further lines of the header
  std::string line_end = "\n";

  [[nodiscard]] int num_arcs() const {
    const int whole = 360 / step_deg;
    if (symmetry == "<rotational>") return 1;
    return symmetry == "<full>" ? whole / 4 + 1 : symmetry == "<horizontal>" ? whole / 2 + 1 : whole;
  }
  [[nodiscard]] std::string text() const {
    const std::string kind = step_deg == 10 ? "CLF1" : "CLF2";
    std::string text = "<" + kind + ">" + line_end + "<VERSION>\t1" + line_end + "<MODELNAME>\tmade" + line_end +
                       "<RADIATION>\t<Fullsphere>" + line_end + "<BALLOON-SYMMETRY>\t" + symmetry + line_end + extra;
    for (const double band : bands_hz) {
      text += fmt::format("<BAND>\t{}", band) + line_end;
      for (int arc = 0; arc < num_arcs(); ++arc)
        for (int angle = 0; angle <= 180; angle += step_deg)
          text += fmt::format("{:.4f}", level_db(angle * std::numbers::pi / 180, arc * step_deg * std::numbers::pi / 180, band)) +
                  (angle == 180 ? line_end : "\t");
    }
    return text + "<" + kind + "END>" + line_end;
  }
};

}  // namespace earshot
