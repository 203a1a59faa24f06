// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <numbers>

/// Weights of the strategies that can make one and the same path (balance heuristic, Veach 1997, chapter 9; docs/explanation/estimators.md,
/// section 4).
///
/// A path is y_0 (source), y_1 ... y_k (surface), y_{k+1} (listener).  Strategy i traces y_1 ... y_i from the source, the rest from the
/// listener, and connects y_i with y_{i+1}.  With p_i the density of making the path so and n_i the number of samples,
/// w_i = n_i p_i / sum_j n_j p_j.  Neighbours differ in one vertex: p_{i-1} / p_i = (density of y_i from the listener's side) / (density of
/// y_i from the source's side), per area.  So all earlier strategies are one running sum kept along the source's subpath, all later ones
/// one kept along the listener's, and a weight costs the same for any length.
///
/// Mirrors and walls passed straight are no vertices here: the segment between the last rough vertex and the next one, unfolded, is one
/// edge that no strategy connects.  Both sides make it with densities cos / length^2 of the unfolded segment, and pick its mirrors with the
/// same probability, so that these cancel.  Positions along the path (`event`) count mirrors and passed walls too.
namespace earshot::mis {

inline constexpr int kMaxSourceBounces = 60;
inline constexpr double kMinCosine = 1e-7;    // grazing: quotients stay finite
inline constexpr double kMinLength2 = 1e-24;  // m^2, of a ray that starts on the surface that it meets: likewise

/// How many samples each strategy gets, relative to one per listener vertex.
struct Strategies {
  double connected = 1;    ///< probability that a listener vertex is connected to anything
  double next_event = 1;   ///< i = 0
  double connection = 0;   ///< 0 < i < k: probability that the one random source vertex is y_i
  double to_listener = 0;  ///< i = k: source paths per listener ray
  int source_bounces = 0;  ///< no strategy with i above this
  /// No strategy connects two surface vertices nearer than this.  Where mirrors close all other edges of a path, nothing else weighs down
  /// the 1 / d^2 of a short one, and near an edge of the mesh its square has no mean.
  double least_edge_m = 0;
};

/// Density per area of a vertex met under `cosine` at `distance` along a direction of density `pdf` per solid angle.
inline double area_pdf(double pdf, double cosine, double distance_m) {
  return pdf * std::max(cosine, kMinCosine) / std::max(distance_m * distance_m, kMinLength2);
}
inline constexpr double kPointPdf = 0.25 / std::numbers::pi;  // source and listener shoot evenly into the sphere

/// The unfinished edge behind the last rough vertex of a subpath.
struct Segment {
  double pdf = kPointPdf;  ///< per solid angle, of its direction
  double cosine = 1;       ///< at its start
  double length_m = 0;     ///< so far
  bool direct = true;      ///< no mirror or passed wall on it yet
  bool from_point = true;  ///< it begins at the source or listener itself
  void pass(double distance_m) { length_m += distance_m, direct = false; }
};

/// Samples of the strategy that connects two surface vertices, per one that could.
inline double samples_of_edge(const Strategies& strategies, double length_m) {
  return length_m < strategies.least_edge_m ? 0.0 : strategies.connection;
}

/// Contribution of a source vertex to every weight: the sum over earlier strategies is
/// (density of the vertex from the listener's side) * inverse_pdf * (before + reverse_pdf * chain),
/// reverse_pdf: density per solid angle of going back toward the vertex before, having come from the other end of the connection.
struct SourceEnd {
  double inverse_pdf = 0, before = 0, chain = 0;
  [[nodiscard]] double earlier(double pdf_from_listener, double reverse_pdf) const {
    return pdf_from_listener * inverse_pdf * (before + reverse_pdf * chain);
  }
};

/// Running sums along a source subpath.
class SourceChain {
 public:
  explicit SourceChain(const Strategies& strategies) : strategies_(&strategies) {}
  Segment& segment() { return segment_; }
  /// A vertex met `distance_m` further on, under `cosine`.
  [[nodiscard]] SourceEnd arrive(double cosine, double distance_m) const {
    const double length_m = segment_.length_m + distance_m;
    SourceEnd end{.inverse_pdf = 1 / area_pdf(segment_.pdf, cosine, length_m)};
    if (segment_.direct) end.before = segment_.from_point ? strategies_->next_event : samples_of_edge(*strategies_, length_m);
    if (!segment_.from_point) end.chain = area_pdf(1, segment_.cosine, length_m) * inverse_pdf_ * sum_;
    return end;
  }
  /// Goes on from that vertex roughly: densities per solid angle forward, and back given where it goes.
  void leave(const SourceEnd& end, double pdf, double reverse_pdf, double cosine) {
    inverse_pdf_ = end.inverse_pdf;
    sum_ = end.before + reverse_pdf * end.chain;
    segment_ = {.pdf = pdf, .cosine = cosine, .length_m = 0, .direct = true, .from_point = false};
  }

 private:
  const Strategies* strategies_;
  Segment segment_;
  double inverse_pdf_ = 0, sum_ = 0;  // of the last rough vertex
};

/// Running sums along a listener subpath.  Strategies are only open up to source_bounces events from the source, and a listener vertex does
/// not know how far that will be: the running sum is kept for the last source_bounces events, and a weight takes a difference.
class ListenerChain {
 public:
  Segment& segment() { return segment_; }
  /// A vertex met `distance_m` further on, under `cosine`.  Valid until leave().
  void arrive(double cosine, double distance_m) {
    const double length_m = segment_.length_m + distance_m;
    length_here_m_ = length_m;
    inverse_pdf_here_ = 1 / area_pdf(segment_.pdf, cosine, length_m);
    chain_here_ = segment_.from_point ? 0.0 : area_pdf(1, segment_.cosine, length_m) * inverse_pdf_;
  }
  /// Sum over later strategies for a connection of this vertex, the `event`-th from the listener, with the source's `source_event`-th
  /// (0: the source itself).  pdf: density per area of this vertex from that end; reverse_pdf: per solid angle, of going back toward the
  /// listener's side having come from that end.
  [[nodiscard]] double later(const Strategies& strategies, int event, int source_event, double pdf, double reverse_pdf) const {
    const int all = source_event + event;                    // k
    const int first_open = all - strategies.source_bounces;  // events from the listener below this are out of reach
    double sum = 0;
    if (segment_.direct && segment_event_ >= first_open) sum += samples_of_segment(strategies);
    if (!segment_.from_point && recorded_event_ >= first_open) {
      const double closed = first_open > 0 ? running_[static_cast<std::size_t>(first_open - 1) % kRing] : 0.0;
      const double open = running_[static_cast<std::size_t>(recorded_event_) % kRing] - closed;
      sum += reverse_pdf * chain_here_ * std::max(open, 0.0) / product_;
    }
    return pdf * inverse_pdf_here_ * sum;
  }
  /// Goes on roughly from the vertex last arrived at, the `event`-th.
  void leave(const Strategies& strategies, int event, double pdf, double reverse_pdf, double cosine) {
    const double before = segment_.from_point ? 0.0 : running_[static_cast<std::size_t>(recorded_event_) % kRing];
    product_ = segment_.from_point ? 1.0 : product_ / (reverse_pdf * chain_here_);
    const int gap_from = std::max(recorded_event_ + 1, segment_event_ - kRing + 1);
    for (int i = gap_from; i < segment_event_; ++i) running_[static_cast<std::size_t>(i) % kRing] = before;
    running_[static_cast<std::size_t>(segment_event_) % kRing] =
        before + (segment_.direct ? samples_of_segment(strategies) * product_ : 0.0);
    recorded_event_ = segment_event_;
    segment_event_ = event;
    inverse_pdf_ = inverse_pdf_here_;
    segment_ = {.pdf = pdf, .cosine = cosine, .length_m = 0, .direct = true, .from_point = false};
  }

 private:
  [[nodiscard]] double samples_of_segment(const Strategies& strategies) const {
    return segment_.from_point ? strategies.to_listener : samples_of_edge(strategies, length_here_m_);
  }

  static constexpr int kRing = 64;
  static_assert(kRing > kMaxSourceBounces + 2);
  Segment segment_;
  int segment_event_ = 0;    // event at which the segment begins; 0: the listener
  int recorded_event_ = -1;  // event of the last entry of `running_`
  double inverse_pdf_ = 0;   // of the vertex at which the segment begins
  double inverse_pdf_here_ = 0, chain_here_ = 0, length_here_m_ = 0;
  double product_ = 1;  // density of the strategy of the last recorded edge, relative to that of the first edge
  std::array<double, kRing> running_{};
};

/// Weight of a strategy with `samples`, given the sums over all others relative to its density.
inline double weight(double samples, double earlier, double later) { return samples / (samples + earlier + later); }

}  // namespace earshot::mis
