// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "apps/options/acoustic_options.h"
#include "datasets/measured/measured_room.h"

namespace earshot {

/// A measured room and how it is simulated: the options of `validate` and `fit-materials`.
struct MeasuredOptions {
  AcousticOptions acoustics;
  std::string measured, places;

  /// --places, --preset, --set, --rate and --seed.
  void add_to(CLI::App& command, const std::string& default_preset);
  [[nodiscard]] MeasuredRoom room() const;
  /// For an omnidirectional microphone; the length of the responses follows from the room unless --set says otherwise.
  [[nodiscard]] AcousticConfig config() const;
  [[nodiscard]] std::shared_ptr<const Scene> scene(const std::string& spec) const;
};

}  // namespace earshot
