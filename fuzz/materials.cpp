// SPDX-License-Identifier: Apache-2.0
// Material databases, in each of the ways to read them.
#include "sim/scene/materials/materials.h"

#include "fuzz/fuzz_target.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  std::string_view text = fuzz::text_of(data, size);
  const unsigned choice = fuzz::take_choice(text, 3);
  fuzz::expect_value_or_refusal([&] {
    std::vector<MaterialWarning> warnings;
    MaterialImport import;
    if (choice == 1) import.warnings = &warnings;
    if (choice == 2) import.reading = CoefficientReading::pressure;
    const MaterialDatabase database = MaterialDatabase::from_json(text, "materials.json", import);
    for (const Material& material : database.all())
      for (const CoefficientCurve* curve : {&material.absorption, &material.scattering, &material.transmission})
        if (const float value = curve->band_mean(88.f, 177.f); !(value >= 0 && value <= 1))
          fuzz::report("a coefficient outside [0, 1]", material.name);
    static_cast<void>(database.find_by_substrings("some Wall"));
    static_cast<void>(database.find_label("Wall"));
  });
  return 0;
}
