// SPDX-License-Identifier: Apache-2.0
#include "trainer/rollout/episode_window.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "sim/base/errors.h"

namespace earshot {

void EpisodeSums::add(const EpisodeMetrics& m) {
  const std::array<double, num_fields> row{1,
                                           m.success,
                                           m.spl,
                                           m.soft_spl,
                                           m.sna,
                                           m.dtg_m,
                                           m.reward,
                                           static_cast<double>(m.steps),
                                           static_cast<double>(m.collisions),
                                           m.stopped ? 1.0 : 0.0};
  for (std::size_t i = 0; i < row.size(); ++i) values[i] += row[i];
}

double EpisodeSums::mean(Field field) const {
  return values[count] > 0 ? values[field] / values[count] : std::numeric_limits<double>::quiet_NaN();
}

void EpisodeWindow::push(const EpisodeSums& sums) {
  if (sums.values[EpisodeSums::count] == 0) return;
  recent_.push_back(sums);
  while (recent_.size() > 1 && total().values[EpisodeSums::count] - recent_.front().values[EpisodeSums::count] >= 200) recent_.pop_front();
}

EpisodeSums EpisodeWindow::total() const {
  EpisodeSums all;
  for (const auto& sums : recent_)
    for (std::size_t i = 0; i < all.values.size(); ++i) all.values[i] += sums.values[i];
  return all;
}

std::vector<double> EpisodeWindow::state() const {
  std::vector<double> state;
  for (const EpisodeSums& sums : recent_) state.insert(state.end(), sums.values.begin(), sums.values.end());
  return state;
}

void EpisodeWindow::restore(std::span<const double> state, int num_fields) {
  const auto width = static_cast<std::size_t>(std::max(num_fields, 0));
  if (width < 1 || width > EpisodeSums::num_fields || state.size() % width != 0 ||
      !std::ranges::all_of(state, [](double value) { return std::isfinite(value); }))
    throw InputError("episode window of the checkpoint", "is not a list of finite sums", "use an earlier checkpoint");
  recent_.clear();
  for (std::size_t first = 0; first < state.size(); first += width) {
    EpisodeSums sums;
    std::ranges::copy(state.subspan(first, width), sums.values.begin());
    recent_.push_back(sums);
  }
}

}  // namespace earshot
