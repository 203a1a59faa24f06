#include "trainer/episode_window.h"

#include <limits>

namespace earshot {

void EpisodeSums::add(const EpisodeMetrics& m) {
  const std::array<double, num_fields> row{
      1, m.success, m.spl, m.soft_spl, m.sna, m.dtg_m, m.reward, static_cast<double>(m.steps), static_cast<double>(m.collisions)};
  for (std::size_t i = 0; i < row.size(); ++i) values[i] += row[i];
}

double EpisodeSums::mean(Field field) const {
  return values[count] > 0 ? values[field] / values[count] : std::numeric_limits<double>::quiet_NaN();
}

void EpisodeWindow::push(const EpisodeSums& sums) {
  recent_.push_back(sums);
  while (recent_.size() > 1 && total().values[EpisodeSums::count] - recent_.front().values[EpisodeSums::count] >= 200) recent_.pop_front();
}

EpisodeSums EpisodeWindow::total() const {
  EpisodeSums all;
  for (const auto& sums : recent_)
    for (std::size_t i = 0; i < all.values.size(); ++i) all.values[i] += sums.values[i];
  return all;
}

}  // namespace earshot
