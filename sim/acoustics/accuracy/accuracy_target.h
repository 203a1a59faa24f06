// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <string>

namespace earshot {

/// Accuracy that a user may request: root mean square errors over octave bands and places, against converged paths.
enum class AccuracyKind { t20, drr, edc, count };
inline constexpr std::size_t kNumAccuracyKinds = static_cast<std::size_t>(AccuracyKind::count);

/// Unit that people read: percent of T20, dB of the direct-to-reverberant ratio of a band, dB of its decay curve down to -30 dB.
struct AccuracyUnit {
  const char* name;    ///< as typed: "t20"
  const char* suffix;  ///< "%" or "dB"
  double scale;        ///< from the number that is kept to the one that is read
};
const AccuracyUnit& unit_of(AccuracyKind kind);

/// One number per kind: T20 as a fraction, the others in dB.  NaN: the reference has no value at any place (no decay in the open).
using AccuracyErrors = std::array<double, kNumAccuracyKinds>;

/// The requested errors, as `t20=5%,drr=1dB,edc=1dB`: any of them, at least one.
struct AccuracyTarget {
  std::array<std::optional<double>, kNumAccuracyKinds> most;

  /// Throws InputError for an invalid list: unknown or repeated names, wrong units, numbers outside of [1 %, 50 %] or [0.1, 10] dB.
  static AccuracyTarget parse(const std::string& text);
  [[nodiscard]] std::string text() const;
  /// The largest of errors[kind] / most[kind] over the requested kinds: at most 1 where the target is met.  A kind without a value counts
  /// as met.
  [[nodiscard]] double used(const AccuracyErrors& errors) const;
  [[nodiscard]] std::optional<double> of(AccuracyKind kind) const { return most[static_cast<std::size_t>(kind)]; }
};

/// "t20 3.9 %, drr 0.41 dB, edc 0.52 dB"; kinds without a value are left out.
std::string text_of(const AccuracyErrors& errors);

}  // namespace earshot
