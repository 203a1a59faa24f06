#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace earshot {

/// A coefficient over frequency: points sorted by frequency, linear in log f between them, held beyond the ends; 0 without points.
struct CoefficientCurve {
  std::vector<float> hz, value;
  [[nodiscard]] float at(float frequency_hz) const;
  /// Mean over log f of [lower_hz, upper_hz] (ORACLES O-31: [125, 0.1, 4000, 0.6] over the band at 707.1 Hz gives 0.35).
  [[nodiscard]] float band_mean(float lower_hz, float upper_hz) const;
  static CoefficientCurve constant(float value);
};

/// Acoustic surface.  All coefficients are energy coefficients in [0, 1] at random incidence: absorption = everything that
/// is not reflected (transmission included), transmission <= absorption, scattering = diffuse share of the reflected energy.
struct Material {
  std::string name;
  std::vector<std::string> labels;  ///< semantic categories, matched as whole words only
  CoefficientCurve absorption, scattering, transmission;
  CoefficientCurve damping_db_per_m;  ///< inside the material
  float speed_m_per_s = 0, density_kg_per_m3 = 0;
  std::string source;  ///< publication of the numbers
  static Material uniform(std::string name, float absorption, float scattering, float transmission = 0);
};

/// One finding of the lint: entry, key, what is wrong.
struct MaterialWarning {
  std::string material, text;
};

/// Materials by exact name.  JSON: {"materials": [{"name", "labels", "absorption", "scattering", "transmission", "damping", "speed",
/// "density", "source"}]}, curves as [Hz, value, ...]; name, absorption and scattering are required, the others default to none or 0.
class MaterialDatabase {
 public:
  /// Throws InputError: missing file, JSON syntax with byte position, missing or mistyped key, coefficient outside [0, 1] or not a
  /// number, negative or zero frequency, unknown key (with the nearest known one), duplicate name, transmission > absorption.
  /// Frequencies may come in any order; of equal ones the last wins.  With a list of warnings, transmission > absorption is
  /// lowered and reported instead of refused: tables of others have such entries (ORACLES.md O-22, H-27).
  static MaterialDatabase from_json(std::string_view json, const std::string& where, std::vector<MaterialWarning>* warnings = nullptr);
  static MaterialDatabase from_file(const std::filesystem::path& path, std::vector<MaterialWarning>* warnings = nullptr);
  /// The database that travels inside the binary (configs/materials.json).
  static MaterialDatabase builtin();

  [[nodiscard]] const Material* find(std::string_view name) const;
  /// Like find, but throws InputError with the nearest known name; `where` names the asking file and key.
  [[nodiscard]] const Material& get(std::string_view name, const std::string& where) const;
  /// The material that carries `category` as a label, compared as a whole, case-folded; nullptr if none.
  [[nodiscard]] const Material* find_label(std::string_view category) const;
  [[nodiscard]] const std::vector<Material>& all() const { return materials_; }

 private:
  std::vector<Material> materials_;
};

}  // namespace earshot
