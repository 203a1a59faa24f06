// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/materials/material_lint.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <utility>

#include "sim/base/text/text_match.h"

namespace earshot {
namespace {

constexpr std::array kUsualCategories = {"wall", "floor",  "ceiling", "door",  "window",  "table",        "chair",  "sofa",
                                         "bed",  "desk",   "cabinet", "shelf", "curtain", "rug",          "carpet", "plant",
                                         "tv",   "mirror", "counter", "sink",  "toilet",  "refrigerator", "stairs", "bathtub"};

struct NamedCurve {
  std::string key;
  const CoefficientCurve* curve;
};

std::array<NamedCurve, 3> curves_of(const Material& m) {
  return {{{"absorption", &m.absorption}, {"scattering", &m.scattering}, {"transmission", &m.transmission}}};
}

bool is_zero(const CoefficientCurve& curve) {
  return std::ranges::all_of(curve.value, [](float value) { return value == 0; });
}

bool is_flat(const CoefficientCurve& curve) {
  return std::ranges::all_of(curve.value, [&](float value) { return value == curve.value.front(); });
}

class Findings {
 public:
  template <class... Args>
  void add(const std::string& material, fmt::format_string<Args...> text, Args&&... args) {
    list.push_back({material, fmt::format(text, std::forward<Args>(args)...)});
  }
  std::vector<MaterialWarning> list;
};

void check_sources(const Material& m, Findings& findings) {
  for (const auto& [key, curve] : curves_of(m)) {
    const std::string& source = m.source_of(key);
    if (key == "transmission" && is_zero(*curve)) continue;  // the default
    if (source.empty()) findings.add(m.name, "{} has no source", key);
    if (is_flat(*curve) && !source.starts_with("derived")) {
      findings.add(m.name, "{} is {:.4g} at all frequencies, which looks like a placeholder", key, curve->value.front());
    }
  }
}

void check_physics(const Material& m, Findings& findings) {
  std::set<float> knots(m.absorption.hz.begin(), m.absorption.hz.end());
  knots.insert(m.transmission.hz.begin(), m.transmission.hz.end());
  for (const float hz : knots) {
    const float a = m.absorption.at(hz), t = m.transmission.at(hz);
    if (t > a + 1e-6f) findings.add(m.name, "transmission {:.4g} exceeds the absorption {:.4g} at {:.4g} Hz", t, a, hz);
  }
}

void check_steps(const Material& m, Findings& findings) {
  for (const auto& [key, curve] : curves_of(m)) {
    // A measured wall may change by up to 16 dB from octave to octave.
    const float limit = key == "transmission" && !m.source_of(key).empty() ? 100.f : 10.f;
    for (std::size_t i = 0; i + 1 < curve->value.size(); ++i) {
      const auto [low, high] = std::minmax(curve->value[i], curve->value[i + 1]);
      if (low > 0 && high > limit * low * 1.001f) {
        findings.add(m.name, "{} steps from {:.4g} at {:.4g} Hz to {:.4g} at {:.4g} Hz", key, curve->value[i], curve->hz[i],
                     curve->value[i + 1], curve->hz[i + 1]);
      }
    }
  }
}

/// Index of the one value that differs by a factor of ten between two curves that agree within 6 % elsewhere; -1 if they are not like that.
int decimal_slip(const CoefficientCurve& a, const CoefficientCurve& b) {
  if (a.hz != b.hz || a.hz.size() < 3) return -1;
  int slip = -1;
  for (std::size_t i = 0; i < a.hz.size(); ++i) {
    if (!(a.value[i] > 0 && b.value[i] > 0)) return -1;
    const float ratio = std::fabs(std::log(a.value[i] / b.value[i]));
    const float tolerance = std::log(1.06f);
    if (ratio < tolerance) continue;
    if (std::fabs(ratio - std::log(10.f)) > tolerance || slip >= 0) return -1;
    slip = static_cast<int>(i);
  }
  return slip;
}

void check_slips(const MaterialDatabase& database, std::size_t index, Findings& findings) {
  const Material& m = database.all()[index];
  for (std::size_t other = 0; other < index; ++other) {
    const Material& o = database.all()[other];
    const auto mine = curves_of(m), theirs = curves_of(o);
    for (std::size_t c = 0; c < mine.size(); ++c) {
      const int slip = decimal_slip(*mine[c].curve, *theirs[c].curve);
      if (slip < 0) continue;
      findings.add(m.name, "{} equals that of '{}' except for {:.4g} instead of {:.4g} at {:.4g} Hz; check the decimal point", mine[c].key,
                   o.name, mine[c].curve->value[slip], theirs[c].curve->value[slip], mine[c].curve->hz[slip]);
    }
  }
}

void check_shared(const MaterialDatabase& database, Findings& findings) {
  std::map<std::vector<float>, std::vector<const Material*>> rows;
  for (const Material& m : database.all()) {
    if (!is_zero(m.transmission) && m.source_of("transmission").empty()) rows[m.transmission.value].push_back(&m);
  }
  for (const auto& [row, materials] : rows) {
    if (materials.size() < 3) continue;
    std::string names;
    for (const Material* m : materials) names += (names.empty() ? "'" : "', '") + m->name;
    findings.add("", "{}' have the same transmission and no source", names);
  }
}

/// Two words of the vocabulary run together; empty if the label is not like that.
std::string fused(const std::string& label, const std::set<std::string>& vocabulary) {
  if (vocabulary.contains(label)) return "";
  for (std::size_t cut = 1; cut < label.size(); ++cut) {
    if (vocabulary.contains(label.substr(0, cut)) && vocabulary.contains(label.substr(cut))) {
      return "'" + label.substr(0, cut) + "' and '" + label.substr(cut) + "'";
    }
  }
  return "";
}

void check_labels(const MaterialDatabase& database, Findings& findings) {
  std::set<std::string> vocabulary;
  const MaterialDatabase builtin = MaterialDatabase::builtin();
  for (const Material& m : builtin.all()) {
    for (const std::string& label : m.labels) vocabulary.insert(label);
  }
  std::map<std::string, std::string> owner, name_of;  // folded label -> material, folded name -> name
  for (const Material& m : database.all()) name_of[fold_case(m.name)] = m.name;
  for (const Material& m : database.all()) {
    for (const std::string& label : m.labels) {
      const std::string folded = fold_case(label);
      const auto [first, is_new] = owner.try_emplace(folded, m.name);
      if (!is_new) findings.add(m.name, "label '{}' occurs twice, first on '{}'", label, first->second);
      const auto named = name_of.find(folded);
      if (named != name_of.end() && named->second != m.name) findings.add(m.name, "label '{}' is the name of another material", label);
      const std::string words = fused(folded, vocabulary);
      if (!words.empty()) findings.add(m.name, "label '{}' looks like {} joined", label, words);
    }
  }
  if (!database.find_label("default")) findings.add("", "no material is labelled 'default'");
  for (const std::string category : kUsualCategories) {
    if (!owner.contains(category) && !name_of.contains(category)) findings.add("", "no material is named or labelled '{}'", category);
  }
}

}  // namespace

std::vector<MaterialWarning> lint(const MaterialDatabase& database) {
  Findings findings;
  for (std::size_t i = 0; i < database.all().size(); ++i) {
    const Material& m = database.all()[i];
    check_sources(m, findings);
    check_physics(m, findings);
    check_steps(m, findings);
    check_slips(database, i, findings);
  }
  check_shared(database, findings);
  check_labels(database, findings);
  return std::move(findings.list);
}

}  // namespace earshot
