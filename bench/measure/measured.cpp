#include "bench/measure/measured.h"

#include <algorithm>

#include "sim/base/errors.h"

namespace earshot {

Measured median_of(std::vector<double> values) {
  require(!values.empty(), "values", values.size(), "a median needs at least one");
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size();
  const double middle = n % 2 == 1 ? values[n / 2] : 0.5 * (values[n / 2 - 1] + values[n / 2]);
  return {middle, values.front(), values.back()};
}

}  // namespace earshot
