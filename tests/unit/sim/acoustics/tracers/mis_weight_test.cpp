// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/tracers/mis_weight.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "sim/base/random.h"

namespace earshot {
namespace {

/// Edges of a random path y_0 ... y_{k+1}: edge i joins y_i and y_{i+1}.  A segment with mirrors is one edge that takes several events.
struct Edge {
  double length_m = 1, near_cosine = 1, far_cosine = 1;  // at its source end and its listener end
  int events = 1;                                        // to its far end; 1: direct
};

struct RandomPath {
  std::vector<Edge> edges;
  std::vector<double> lobe;  // per inner vertex: probability that its diffuse lobe is picked
  [[nodiscard]] int surfaces() const { return static_cast<int>(edges.size()) - 1; }
  /// Events from the source to the source end of edge i.
  [[nodiscard]] int event_of(int i) const {
    int events = 0;
    for (int e = 0; e < i; ++e) events += edges[e].events;
    return events;
  }
  [[nodiscard]] int all_events() const {  // k
    return event_of(static_cast<int>(edges.size())) - 1;
  }
};

RandomPath draw_path(std::uint32_t index, int surfaces, bool mirrors) {
  const RandomStream random(11, Purpose::test, index);
  RandomPath path;
  for (int i = 0; i <= surfaces; ++i) {
    const auto u = random.uniform4(static_cast<std::uint32_t>(i));
    const auto v = random.uniform4(1000u + static_cast<std::uint32_t>(i));
    Edge edge{.length_m = std::pow(100.0, u[0] - 0.5), .near_cosine = 0.01 + 0.99 * u[1], .far_cosine = 0.01 + 0.99 * u[2]};
    if (mirrors && u[3] < 0.4f) edge.events = 2 + static_cast<int>(v[1] * 3);
    path.edges.push_back(edge);
    path.lobe.push_back(0.05 + 0.95 * v[0]);
  }
  return path;
}

double lambert(double cosine) { return cosine / std::numbers::pi; }

/// The weight of connecting edge i, by the code under test, walking both subpaths.
double weight_by_chains(const RandomPath& path, const mis::Strategies& strategies, int i) {
  const int k = path.surfaces();
  mis::SourceChain source(strategies);
  mis::SourceEnd end;
  for (int v = 1; v <= i; ++v) {
    const Edge& edge = path.edges[v - 1];
    for (int e = 1; e < edge.events; ++e) source.segment().pass(edge.length_m / edge.events);
    end = source.arrive(edge.far_cosine, edge.length_m / edge.events);
    if (v == i) break;
    source.leave(end, path.lobe[v] * lambert(path.edges[v].near_cosine), path.lobe[v] * lambert(edge.far_cosine),
                 path.edges[v].near_cosine);
  }
  mis::ListenerChain listener;
  int event = 0;
  for (int v = k; v > i; --v) {  // vertex v is met along edge v
    const Edge& edge = path.edges[v];
    for (int e = 1; e < edge.events; ++e) listener.segment().pass(edge.length_m / edge.events);
    event += edge.events;
    listener.arrive(edge.near_cosine, edge.length_m / edge.events);
    if (v == i + 1) break;
    listener.leave(strategies, event, path.lobe[v] * lambert(path.edges[v - 1].far_cosine), path.lobe[v] * lambert(edge.near_cosine),
                   path.edges[v - 1].far_cosine);
  }
  const Edge& edge = path.edges[i];
  double earlier = 0, later = 0, samples = strategies.connection;
  if (i > 0) {
    const double pdf = i == k ? mis::kPointPdf : path.lobe[i + 1] * lambert(edge.far_cosine);
    earlier = end.earlier(mis::area_pdf(pdf, edge.near_cosine, edge.length_m), path.lobe[i] * lambert(path.edges[i - 1].far_cosine));
  } else {
    samples = strategies.next_event;
  }
  if (i < k) {
    const double pdf = i == 0 ? mis::kPointPdf : path.lobe[i] * lambert(edge.near_cosine);
    later = listener.later(strategies, event, path.event_of(i), mis::area_pdf(pdf, edge.far_cosine, edge.length_m),
                           path.lobe[i + 1] * lambert(path.edges[i + 1].near_cosine));
  } else {
    samples = strategies.to_listener;
  }
  return mis::weight(samples, earlier, later);
}

/// The closed form of docs/explanation/estimators.md, section 4 for Lambert vertices: w_i = (n_i / G_i) / sum_j (n_j / G_j), G_i the area
/// density of edge i, with the lobe probabilities of the two vertices that a connection does not draw.
std::vector<double> weights_by_closed_form(const RandomPath& path, const mis::Strategies& strategies) {
  const int k = path.surfaces();
  std::vector<double> weights(path.edges.size());
  double sum = 0;
  for (int i = 0; i <= k; ++i) {
    const Edge& edge = path.edges[i];
    double density = 1 / (edge.length_m * edge.length_m);
    density *= i == 0   ? edge.far_cosine / (4 * std::numbers::pi)
               : i == k ? edge.near_cosine / (4 * std::numbers::pi)
                        : edge.near_cosine * edge.far_cosine / std::numbers::pi;
    if (i > 0) density *= path.lobe[i];
    if (i < k) density *= path.lobe[i + 1];
    double samples = i == 0 ? strategies.next_event : i == k ? strategies.to_listener : strategies.connection;
    if (edge.events > 1 || path.event_of(i) > strategies.source_bounces) samples = 0;
    if (i > 0 && i < k && edge.length_m < strategies.least_edge_m) samples = 0;
    weights[i] = samples / density;
    sum += weights[i];
  }
  for (double& weight : weights) weight = sum > 0 ? weight / sum : 0;
  return weights;
}

TEST(MisWeight, EqualsTheClosedFormForLambertPathsBdpt) {
  for (const bool mirrors : {false, true}) {
    for (const int depth : {1, 3, 10, 60}) {
      const mis::Strategies strategies{.next_event = 1, .connection = 1.0 / depth, .to_listener = 0.3, .source_bounces = depth};
      for (std::uint32_t index = 0; index < 300; ++index) {
        const RandomPath path = draw_path(index, 1 + static_cast<int>(index % 40), mirrors);
        const std::vector<double> expected = weights_by_closed_form(path, strategies);
        double sum = 0, expected_sum = 0;
        for (int i = 0; i <= path.surfaces(); ++i) {
          expected_sum += expected[i];
          if (expected[i] == 0) continue;  // not a strategy of this path
          const double weight = weight_by_chains(path, strategies, i);
          EXPECT_NEAR(weight, expected[i], 1e-5) << "path " << index << ", edge " << i << ", depth " << depth;
          sum += weight;
        }
        EXPECT_NEAR(sum, expected_sum, 1e-5);
      }
    }
  }
}

TEST(MisWeight, EdgesTooShortToConnectHaveNoWeight) {
  // Lengths are even in log from 0.1 to 10 m: half of the inner edges of these paths are closed.
  const mis::Strategies strategies{
      .connected = 0.5, .next_event = 0.5, .connection = 0.05, .to_listener = 0.3, .source_bounces = 10, .least_edge_m = 1};
  for (std::uint32_t index = 0; index < 300; ++index) {
    const RandomPath path = draw_path(index, 1 + static_cast<int>(index % 40), index % 2 == 1);
    const std::vector<double> expected = weights_by_closed_form(path, strategies);
    double sum = 0, expected_sum = 0;
    for (int i = 0; i <= path.surfaces(); ++i) {
      expected_sum += expected[i];
      if (expected[i] == 0) continue;
      const double weight = weight_by_chains(path, strategies, i);
      EXPECT_NEAR(weight, expected[i], 1e-5) << "path " << index << ", edge " << i;
      sum += weight;
    }
    EXPECT_NEAR(sum, expected_sum, 1e-5);
  }
}

TEST(MisWeight, NextEventAloneWeighsOne) {
  const mis::Strategies strategies;
  const RandomPath path = draw_path(1, 7, false);
  EXPECT_EQ(weight_by_chains(path, strategies, 0), 1.0);
}

TEST(MisWeight, LongPathsKeepTheirSums) {
  // A thousand events: running sums must not lose the last ones.
  const mis::Strategies strategies{.next_event = 1, .connection = 0.1, .to_listener = 0.5, .source_bounces = 10};
  const RandomPath path = draw_path(5, 1000, false);
  const std::vector<double> expected = weights_by_closed_form(path, strategies);
  for (int i = 0; i <= 10; ++i) EXPECT_NEAR(weight_by_chains(path, strategies, i), expected[i], 1e-5);
}

}  // namespace
}  // namespace earshot
