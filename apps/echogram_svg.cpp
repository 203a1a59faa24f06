#include "apps/echogram_svg.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "sim/acoustics/metrics/room_metrics.h"

namespace earshot {
namespace {

constexpr double kLeft = 64, kWidth = 640, kFloorDb = -60, kCeilingDb = 5;

struct Panel {
  double top, height, end_s;
  [[nodiscard]] double x(double t_s) const { return kLeft + kWidth * std::clamp(t_s / end_s, 0.0, 1.0); }
  /// kCeilingDb at the top, kFloorDb at the bottom.
  [[nodiscard]] double y(double level_db) const {
    return top + height * (kCeilingDb - std::clamp(level_db, kFloorDb, kCeilingDb)) / (kCeilingDb - kFloorDb);
  }
};

struct Kind {
  ArrivalKind kind;
  const char *label, *colour;
};
constexpr std::array<Kind, 4> kKinds{{{ArrivalKind::direct, "direct", "#111111"},
                                      {ArrivalKind::reflection, "reflected", "#2a6fdb"},
                                      {ArrivalKind::diffraction, "diffracted", "#2e9a4f"},
                                      {ArrivalKind::transmission, "through walls", "#d9480f"}}};
constexpr const char* kLateColour = "#c9d2dc";

double db(double ratio) { return 10 * std::log10(std::max(ratio, 1e-12)); }

double energy_of(const Arrival& arrival, int band) { return double{arrival.amplitude[band]} * arrival.amplitude[band]; }

int band_near_1khz(const BandLayout& bands) {
  int best = 0;
  for (int b = 0; b < bands.size(); ++b)
    if (std::abs(std::log(bands.centre_hz[b] / 1000.f)) < std::abs(std::log(bands.centre_hz[best] / 1000.f))) best = b;
  return best;
}

/// Energy per millisecond from emission on, paths included.
std::vector<double> series_of(const AcousticScene& scene, const EnergyResponse& response, int band) {
  constexpr double bin_s = 1e-3;
  std::vector<double> series(static_cast<std::size_t>(std::ceil(scene.config().rir_length_s / bin_s)) + 1, 0.0);
  for (const Arrival& arrival : response.arrivals) {
    const auto bin = static_cast<std::size_t>(arrival.distance_m / response.speed_of_sound_m_per_s / bin_s);
    if (bin < series.size()) series[bin] += energy_of(arrival, band);
  }
  const EnergyHistogram& late = response.late;
  for (std::size_t i = 0; i < series.size() && late.num_bins() > 0; ++i) {
    const auto bin = static_cast<int>((static_cast<double>(i) + 0.5) * bin_s / late.bin_s());
    if (bin < late.num_bins()) series[i] += late.energy(bin, band) * bin_s / late.bin_s();
  }
  return series;
}

std::vector<double> decay_db(const std::vector<double>& series) {
  std::vector<double> edc(series.size());
  energy_decay_curve(series, edc);
  const double whole = edc.empty() ? 0.0 : edc.front();
  for (double& value : edc) value = whole > 0 ? db(value / whole) : kFloorDb;
  return edc;
}

/// 1, 2 or 5 times a power of ten, such that four to ten of them make `length_s`.
double tick_step_s(double length_s) {
  const double decade_s = std::pow(10.0, std::floor(std::log10(length_s / 4)));
  for (const double step_s : {5 * decade_s, 2 * decade_s})
    if (length_s / step_s >= 4) return step_s;
  return decade_s;
}

std::string escape_xml(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    if (c == '&')
      escaped += "&amp;";
    else if (c == '<')
      escaped += "&lt;";
    else if (c == '>')
      escaped += "&gt;";
    else
      escaped += c;
  }
  return escaped;
}

std::string axes(const Panel& panel, const std::string& unit) {
  std::string svg = fmt::format("<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"#999\"/>\n", kLeft, panel.top,
                                kWidth, panel.height);
  for (int level = 0; level >= static_cast<int>(kFloorDb); level -= 20)
    svg += fmt::format(
        "<line x1=\"{0}\" x2=\"{1}\" y1=\"{2:.1f}\" y2=\"{2:.1f}\" stroke=\"#e6e6e6\"/><text x=\"{3}\" y=\"{4:.1f}\" "
        "text-anchor=\"end\">{5}</text>\n",
        kLeft, kLeft + kWidth, panel.y(level), kLeft - 8, panel.y(level) + 4, level);
  const double step_s = tick_step_s(panel.end_s);
  for (int i = 0; i * step_s <= panel.end_s * (1 + 1e-9); ++i)
    svg += fmt::format("<text x=\"{:.1f}\" y=\"{}\" text-anchor=\"middle\">{:.4g}</text>\n", panel.x(i * step_s),
                       panel.top + panel.height + 16, 1000 * step_s * i);
  return svg + fmt::format("<text transform=\"translate(16 {:.1f}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n",
                           panel.top + panel.height / 2, unit);
}

/// Low bands dark, high bands light.
std::string band_colour(int band, int count) {
  const double share = count > 1 ? static_cast<double>(band) / (count - 1) : 0.0;
  return fmt::format("hsl({:.0f} 70% {:.0f}%)", 260 - 220 * share, 32 + 20 * share);
}

std::string echogram(const Panel& panel, const EnergyResponse& response, int band) {
  const double speed = response.speed_of_sound_m_per_s;
  const EnergyHistogram& late = response.late;
  double loudest = 0;
  for (const Arrival& arrival : response.arrivals) loudest = std::max(loudest, energy_of(arrival, band));
  const double per_ms = late.num_bins() > 0 ? 1e-3 / late.bin_s() : 0.0;
  if (loudest == 0)
    for (int bin = 0; bin < late.num_bins(); ++bin) loudest = std::max(loudest, late.energy(bin, band) * per_ms);
  if (loudest == 0) return {};

  std::string svg = fmt::format("<polygon fill=\"{}\" points=\"{:.1f},{:.1f} ", kLateColour, panel.x(0), panel.y(kFloorDb));
  for (int bin = 0; bin < late.num_bins(); ++bin) {
    const double level = panel.y(db(late.energy(bin, band) * per_ms / loudest));
    svg += fmt::format("{:.1f},{:.1f} {:.1f},{:.1f} ", panel.x(bin * double{late.bin_s()}), level,
                       panel.x((bin + 1) * double{late.bin_s()}), level);
  }
  svg += fmt::format("{:.1f},{:.1f}\"/>\n", panel.x(panel.end_s), panel.y(kFloorDb));
  for (const Arrival& arrival : response.arrivals) {
    const double level_db = db(energy_of(arrival, band) / loudest);
    if (level_db <= kFloorDb) continue;
    const auto kind = std::find_if(kKinds.begin(), kKinds.end(), [&](const Kind& k) { return k.kind == arrival.kind; });
    svg += fmt::format(
        "<line x1=\"{0:.1f}\" x2=\"{0:.1f}\" y1=\"{1:.1f}\" y2=\"{2:.1f}\" stroke=\"{3}\" stroke-width=\"1.6\"/><circle cx=\"{0:.1f}\" "
        "cy=\"{1:.1f}\" r=\"2.4\" fill=\"{3}\"/>\n",
        panel.x(arrival.distance_m / speed), panel.y(level_db), panel.y(kFloorDb), kind->colour);
  }
  return svg;
}

}  // namespace

std::string echogram_svg(const std::string& title, const AcousticScene& scene, const EnergyResponse& response) {
  std::vector<std::vector<double>> decays;
  double end_s = 0.05;
  for (int band = 0; band < scene.num_bands(); ++band) {
    decays.push_back(decay_db(series_of(scene, response, band)));
    const auto end = std::find_if(decays.back().begin(), decays.back().end(), [](double level) { return level <= kFloorDb; });
    end_s = std::max(end_s, 1e-3 * static_cast<double>(end - decays.back().begin()));
  }
  end_s = tick_step_s(end_s) * std::ceil(end_s / tick_step_s(end_s));
  const int shown = band_near_1khz(scene.bands());
  const Panel upper{56, 220, end_s}, lower{330, 200, end_s};
  std::string svg =
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"730\" height=\"580\" font-family=\"sans-serif\" font-size=\"12\" fill=\"#333\">\n"
      "<rect width=\"730\" height=\"580\" fill=\"#fff\"/>\n";
  svg += fmt::format("<text x=\"{}\" y=\"22\" font-size=\"15\">{}</text>\n", kLeft, escape_xml(title));
  double x = kLeft;
  const auto legend = [&](const std::string& label, const std::string& colour, double y) {
    svg +=
        fmt::format("<rect x=\"{:.0f}\" y=\"{:.0f}\" width=\"10\" height=\"10\" fill=\"{}\"/><text x=\"{:.0f}\" y=\"{:.0f}\">{}</text>\n",
                    x, y - 9, colour, x + 14, y, label);
    x += 30 + 7 * static_cast<double>(label.size());
  };
  for (const Kind& kind : kKinds) legend(kind.label, kind.colour, 44);
  legend("late, per millisecond", kLateColour, 44);
  svg += echogram(upper, response, shown) + axes(upper, fmt::format("dB, {:.0f} Hz band", scene.bands().centre_hz[shown]));
  x = kLeft;
  for (int band = 0; band < scene.num_bands(); ++band) {
    legend(fmt::format("{:.0f} Hz", scene.bands().centre_hz[band]), band_colour(band, scene.num_bands()), 322);
    std::string points;
    for (std::size_t i = 0; i < decays[band].size() && decays[band][i] > kFloorDb; ++i)
      points += fmt::format("{:.1f},{:.1f} ", lower.x(1e-3 * static_cast<double>(i)), lower.y(decays[band][i]));
    svg += fmt::format("<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"1.6\"/>\n", points,
                       band_colour(band, scene.num_bands()));
  }
  svg += axes(lower, "energy decay, dB");
  return svg +
         fmt::format("<text x=\"{}\" y=\"568\" text-anchor=\"middle\">milliseconds after emission</text>\n</svg>\n", kLeft + kWidth / 2);
}

}  // namespace earshot
