// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace earshot {

/// A coefficient over frequency: points sorted by frequency, linear in log f between them, held beyond the ends; 0 without points.
struct CoefficientCurve {
  std::vector<float> hz, value;
  [[nodiscard]] float at(float frequency_hz) const;
  /// Mean over log f of [lower_hz, upper_hz] (docs/evidence/oracles.md, O-31: [125, 0.1, 4000, 0.6] over the band at 707.1 Hz gives 0.35).
  [[nodiscard]] float band_mean(float lower_hz, float upper_hz) const;
  static CoefficientCurve constant(float value);
};

/// Acoustic surface.  All coefficients are energy coefficients in [0, 1] at random incidence: absorption = everything that
/// is not reflected (transmission included), transmission <= absorption, scattering = diffuse fraction of the reflected energy.
struct Material {
  std::string name;
  std::vector<std::string> labels;  ///< semantic categories, matched as whole words only
  CoefficientCurve absorption, scattering, transmission;
  CoefficientCurve damping_db_per_m;  ///< inside the material
  float speed_m_per_s = 0, density_kg_per_m3 = 0;
  /// Specular reflections depend on the angle as from a locally reacting wall (wall_impedance.h).  false: the same at every angle.
  bool locally_reacting = false;
  /// Specific impedance of a locally reacting wall, of equal frequencies; empty: the real one that its absorption belongs to.  absorption
  /// is then that of this impedance at random incidence.
  CoefficientCurve impedance_real, impedance_imaginary;
  std::string source;                          ///< where the numbers come from, all of it as one text
  std::map<std::string, std::string> sources;  ///< per key (absorption, scattering, ...), if the file says it per key
  std::string category;                        ///< semantic category that chose this material (semantic_materials.h); empty if none did
  /// What `sources` says about this key, else `source`.
  [[nodiscard]] const std::string& source_of(const std::string& key) const;
  static Material uniform(std::string name, float absorption, float scattering, float transmission = 0);
};

/// One finding of the lint: entry, key, what is wrong.
struct MaterialWarning {
  std::string material, text;
};

/// What the numbers of a material file mean.  Textbooks print fractions of the energy; the predecessor's header calls its table fractions
/// of the pressure, though it holds textbook values (docs/evidence/oracles.md, O-15).
enum class CoefficientReading {
  energy,
  pressure,  ///< 1 - absorption is a pressure ratio: alpha = 1 - (1 - a)^2, tau = t^2; scattering as it stands
};

/// How to read a material file.
struct MaterialImport {
  std::optional<CoefficientReading> reading =
      std::nullopt;                                  ///< not given: what the file says under "coefficients", else energy; both must agree
  std::vector<MaterialWarning>* warnings = nullptr;  ///< as below
  bool keep_transmission = false;                    ///< neither refuse nor lower transmission > absorption: for the lint, not for a scene
};

/// Materials by exact name.  JSON: {"coefficients": "energy" or "pressure", "materials": [{"name", "labels", "absorption", "scattering",
/// "transmission", "damping", "speed", "density", "angle", "impedance", "source"}]}, curves as [Hz, value, ...]; name, absorption and
/// scattering are required, the others default to none or 0; with "impedance", [Hz, real, imaginary, ...], absorption follows from it.
/// "source" is text, or one text per key: {"absorption": "...", ...}.  The files of the predecessor (flat arrays, labels, damping, speed,
/// density) are of this layout too.
class MaterialDatabase {
 public:
  /// Throws InputError: missing file, JSON syntax with byte position, missing or mistyped key, coefficient outside [0, 1] or not a
  /// number, negative or zero frequency, unknown key (with the nearest known one), duplicate name, transmission > absorption.
  /// Frequencies may come in any order; of equal ones the last wins.  With a list of warnings, transmission > absorption is
  /// lowered and reported instead of refused: published tables have such entries (docs/evidence/oracles.md, O-22;
  /// docs/evidence/stability.md, H-27).
  static MaterialDatabase from_json(std::string_view json, const std::string& where, std::vector<MaterialWarning>* warnings = nullptr);
  static MaterialDatabase from_json(std::string_view json, const std::string& where, const MaterialImport& import);
  static MaterialDatabase from_file(const std::filesystem::path& path, std::vector<MaterialWarning>* warnings = nullptr);
  static MaterialDatabase from_file(const std::filesystem::path& path, const MaterialImport& import);
  /// The database that travels inside the binary (configs/materials.json).
  static MaterialDatabase builtin();

  [[nodiscard]] const Material* find(std::string_view name) const;
  /// Like find, but throws InputError with the nearest known name; `where` names the file and key that refer to it.
  [[nodiscard]] const Material& get(std::string_view name, const std::string& where) const;
  /// The predecessor's choice (docs/reference/formats.md, section 2), to reproduce its numbers: the material with the most labels that
  /// occur anywhere inside the lower-cased `category`, a label listed twice counting twice; of equal ones the first in the file (the
  /// predecessor leaves that open); nullptr if no label occurs.  So `vegetable` is a `table`.
  [[nodiscard]] const Material* find_by_substrings(std::string_view category) const;
  /// The material that carries `category` as a label, compared as a whole, case-folded; nullptr if none.
  [[nodiscard]] const Material* find_label(std::string_view category) const;
  [[nodiscard]] const std::vector<Material>& all() const { return materials_; }

 private:
  std::vector<Material> materials_;
};

}  // namespace earshot
