// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/accuracy/cross_validation.h"

#include <algorithm>
#include <cmath>

namespace earshot {

void PlaceMean::add(std::size_t place, double value) {
  places_[place].add(value);
  all_.add(value);
}

double PlaceMean::mean() const { return all_.count == 0 ? std::nan("") : all_.value(); }

double PlaceMean::standard_error() const {
  if (all_.count == 0) return std::nan("");
  double squares = 0, count = 0;
  for (const Sum& place : places_)
    if (place.count > 0) squares += (place.value() - all_.value()) * (place.value() - all_.value()), ++count;
  return count > 1 ? std::sqrt(squares / (count * (count - 1))) : 0.0;
}

RootMeanSquare root_mean_square(const PlaceMean& squares, double sigmas) {
  if (squares.count() == 0) return {std::nan(""), std::nan("")};
  const double mean = std::max(squares.mean(), 0.0), error = squares.standard_error(), value = std::sqrt(mean + sigmas * error);
  return {value, std::sqrt(mean + (sigmas + 1) * error) - value};
}

}  // namespace earshot
