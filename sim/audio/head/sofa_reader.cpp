// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/sofa_reader.h"

#include <fmt/format.h>
#include <mysofa.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <glm/geometric.hpp>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "sim/audio/measured/ear_order.h"
#include "sim/audio/measured/listener_frame.h"
#include "sim/audio/measured/sofa_convention.h"
#include "sim/audio/transforms/resample.h"
#include "sim/base/byte_stream.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/process/isolated_call.h"

namespace earshot {
namespace {

constexpr std::size_t kMaxFileBytes = std::size_t{1} << 30;
constexpr unsigned kMinDirections = 8, kMaxDirections = 100000, kMaxTaps = 16384;
constexpr std::string_view kRemedy = "use a SimpleFreeFieldHRIR SOFA file";

struct FreeResponses {
  void operator()(MYSOFA_HRTF* responses) const noexcept { mysofa_free(responses); }
};

std::string describe(int status) {
  switch (status) {
    case MYSOFA_INVALID_FORMAT:
      return "is not a SOFA file, or is damaged";
    case MYSOFA_UNSUPPORTED_FORMAT:
      return "is of a SOFA version or HDF5 layout that libmysofa cannot read";
    case MYSOFA_NO_MEMORY:
      return "needs more memory than is available; the file may be damaged";
    case MYSOFA_READ_ERROR:
      return "ends too early";
    case MYSOFA_INVALID_ATTRIBUTES:
      return "has no global attributes of AES69 (Conventions, DataType)";
    case MYSOFA_INVALID_DIMENSIONS:
      return "has wrong dimensions (M, R, E, N)";
    case MYSOFA_INVALID_DIMENSION_LIST:
      return "has a wrong DIMENSION_LIST";
    case MYSOFA_INVALID_COORDINATE_TYPE:
      return "has an unknown coordinate Type";
    case MYSOFA_ONLY_DELAYS_WITH_IR_OR_MR_SUPPORTED:
      return "has Data.Delay of a shape other than [I, R] or [M, R]";
    case MYSOFA_ONLY_THE_SAME_SAMPLING_RATE_SUPPORTED:
      return "has more than one Data.SamplingRate";
    case MYSOFA_INVALID_RECEIVER_POSITIONS:
      return "has ReceiverPosition values that are not ears";
    default:
      return fmt::format("is not readable as SOFA (libmysofa error {})", status);
  }
}

/// End of the file according to its HDF5 superblock (HDF5 file format specification 3.0, section II.A); 0 if there is none to read.
std::uint64_t stated_size(std::string_view bytes) {
  if (!bytes.starts_with("\x89HDF\r\n\x1a\n") || bytes.size() < 64) return 0;
  const auto version = static_cast<unsigned char>(bytes[8]);
  if (version > 3) return 0;
  const std::size_t at = version == 0 ? 40 : version == 1 ? 44 : 28;
  const auto offset_bytes = static_cast<unsigned char>(bytes[version < 2 ? 13 : 9]);
  if (offset_bytes != 8) return 0;
  std::uint64_t size = 0;
  for (std::size_t i = 8; i-- > 0;) size = size << 8 | static_cast<unsigned char>(bytes[at + i]);
  return size;
}

using Refusal = std::function<InputError(const std::string&)>;

/// Triplets of a variable: one for all measurements, or one for each.
class Triplets {
 public:
  /// type: of coordinates where the variable does not say it.  Throws unless it has 3 or 3 M values.
  Triplets(const MYSOFA_ARRAY& array, const char* name, std::string type, std::size_t measurements, const Refusal& refuse)
      : values_(array.values, array.values ? array.elements : 0), shared_(array.elements == 3) {
    if (array.elements != 3 && array.elements != 3 * measurements)
      throw refuse(fmt::format("has {} values in {} instead of {} or 3", array.elements, name, 3 * measurements));
    if (values_.empty()) throw refuse(fmt::format("has no values in {}", name));
    for (const MYSOFA_ATTRIBUTE* at = array.attributes; at; at = at->next)
      if (at->name && at->value && std::string_view(at->name) == "Type") type = at->value;
    if (type != "cartesian" && type != "spherical")
      throw refuse(fmt::format("has {} of Type '{}', which is neither cartesian nor spherical", name, type));
    spherical_ = type == "spherical";
  }
  [[nodiscard]] bool spherical() const { return spherical_; }
  /// In metres, axes of SOFA.
  [[nodiscard]] glm::dvec3 operator[](std::size_t measurement) const {
    const float* value = values_.data() + (shared_ ? 0 : 3 * measurement);
    return sofa_position({value[0], value[1], value[2]}, spherical_);
  }

 private:
  std::span<const float> values_;
  bool shared_, spherical_ = false;
};

/// Writes directions and distances of the sources as the listener has them.
void place_sources(const MYSOFA_HRTF& sofa, const Refusal& refuse, SofaResponses& responses) {
  const auto measurements = static_cast<std::size_t>(sofa.M);
  const Triplets source(sofa.SourcePosition, "SourcePosition", "", measurements, refuse);
  const auto read = [&](const MYSOFA_ARRAY& array, const char* name, const std::string& type) {
    return array.elements == 0 ? std::optional<Triplets>() : Triplets(array, name, type, measurements, refuse);
  };
  const auto listener = read(sofa.ListenerPosition, "ListenerPosition", "cartesian");
  const auto view = read(sofa.ListenerView, "ListenerView", "cartesian");
  // Its Type is that of ListenerView, but for files that mean cartesian and have (0, 0, 1) in both.
  const auto up = read(sofa.ListenerUp, "ListenerUp", view && view->spherical() ? "spherical" : "cartesian");
  const auto plain_up = read(sofa.ListenerUp, "ListenerUp", "cartesian");
  for (std::size_t m = 0; m < measurements; ++m) {
    const glm::dvec3 front = view ? (*view)[m] : glm::dvec3(1, 0, 0);
    if (!(glm::length(front) > 1e-6) || !std::isfinite(glm::length(front)))
      throw refuse(fmt::format("has no direction in ListenerView {}", view ? m : 0));
    glm::dvec3 crown = up ? (*up)[m] : glm::dvec3(0, 0, 1);
    if (up && glm::length(glm::cross(crown, front)) < 1e-6) crown = (*plain_up)[m];
    const glm::dvec3 towards = ListenerFrame(listener ? (*listener)[m] : glm::dvec3(0), front, crown).to_head(source[m]);
    const double distance = glm::length(towards);
    if (!(distance > 1e-6) || !std::isfinite(distance)) throw refuse(fmt::format("has no direction in SourcePosition {}", m));
    responses.direction.emplace_back(towards / distance);
    responses.distance_m.push_back(static_cast<float>(distance));
  }
}

/// Whether the second of the two receivers is the left ear.  Labels that name the left one first are right; those that name it second are
/// in some files (of the first API) and not in others.
bool second_is_left(const MYSOFA_HRTF& sofa, const SofaResponses& as_stored, const Refusal& refuse) {
  MYSOFA_ARRAY pair = sofa.ReceiverPosition;  // [2, 3, 1] or [2, 3, M]: of the first measurement
  const std::size_t step = std::max<std::size_t>(1, pair.elements / 6);
  std::array<float, 6> values{};
  for (std::size_t i = 0; i < 6; ++i) values[i] = sofa.ReceiverPosition.values[i * step];
  pair.values = values.data();
  pair.elements = 6;
  const Triplets ears(pair, "ReceiverPosition", "cartesian", 2, refuse);
  const double to_the_left = ears[0].y - ears[1].y;
  if (to_the_left > 0) return false;
  const int first_is_left =
      weigh_ears(as_stored.direction, as_stored.taps, as_stored.num_taps, as_stored.delay_samples, as_stored.sample_rate_hz)
          .first_is_left();
  if (first_is_left == 0 && !(to_the_left < 0)) throw refuse("has ReceiverPosition values that do not distinguish the left and right ear");
  return first_is_left <= 0;
}

/// Everything that the arrays must hold before they are read.
void check_sizes(const MYSOFA_HRTF& sofa, const Refusal& refuse) {
  if (sofa.R != 2) throw refuse(fmt::format("has {} receivers (R) instead of two ears", sofa.R));
  if (sofa.M < kMinDirections || sofa.M > kMaxDirections) throw refuse(fmt::format("has {} measurements (M)", sofa.M));
  if (sofa.N < 1 || sofa.N > kMaxTaps) throw refuse(fmt::format("has {} samples per response (N)", sofa.N));
  const auto measurements = static_cast<std::size_t>(sofa.M), taps = static_cast<std::size_t>(sofa.N);
  const auto expect_size = [&](const MYSOFA_ARRAY& array, std::size_t size, const char* field) {
    if (array.elements != size || !array.values)
      throw refuse(fmt::format("has {} values in {} instead of {}", array.elements, field, size));
  };
  expect_size(sofa.DataIR, measurements * 2 * taps, "Data.IR");
  expect_size(sofa.DataSamplingRate, 1, "Data.SamplingRate");
  if (sofa.DataDelay.elements != 0 && sofa.DataDelay.elements != 2) expect_size(sofa.DataDelay, measurements * 2, "Data.Delay");
  const unsigned ears = sofa.ReceiverPosition.elements;
  if ((ears != 6 && ears != 6 * sofa.M) || !sofa.ReceiverPosition.values) throw refuse("has no ReceiverPosition for two ears");
  for (unsigned i = 0; i < sofa.EmitterPosition.elements && sofa.EmitterPosition.values; ++i)
    if (std::abs(sofa.EmitterPosition.values[i]) > 1e-3f) throw refuse("has an EmitterPosition other than 0");
}

void exchange_ears(SofaResponses& responses) {
  const auto taps = static_cast<std::ptrdiff_t>(responses.num_taps);
  for (std::size_t m = 0; m < responses.direction.size(); ++m) {
    const auto left = responses.taps.begin() + static_cast<std::ptrdiff_t>(2 * m) * taps;
    std::swap_ranges(left, left + taps, left + taps);
    std::swap(responses.delay_samples[2 * m], responses.delay_samples[2 * m + 1]);
  }
}

}  // namespace

SofaResponses read_sofa(const std::filesystem::path& path) {
  const std::string where = path.string();
  const IsolationLimits limits = limits_for_file(path);
  return decode_responses(call_isolated(reader_program(), {"sofa", where}, where, limits), where);
}

SofaResponses parse_sofa(const std::filesystem::path& path) {
  const std::string name = path.string();
  const Refusal refuse = [&](const std::string& problem) { return InputError(name, problem, kRemedy); };
  const std::string bytes = read_file(path, kMaxFileBytes);
  // libmysofa 1.3 writes past its stack on files that end too early, so it is never given one.
  const std::uint64_t stated = stated_size(bytes);
  if (stated == 0) throw refuse(describe(MYSOFA_INVALID_FORMAT));
  if (stated > bytes.size()) throw refuse(fmt::format("is truncated: {} of {} bytes", bytes.size(), stated));
  if (const auto contents = refusal_of_convention(find_sofa_convention(bytes))) throw refuse(*contents);
  int status = MYSOFA_OK;
  const std::unique_ptr<MYSOFA_HRTF, FreeResponses> sofa{mysofa_load_data(bytes.data(), bytes.size(), &status)};
  if (!sofa || status != MYSOFA_OK) throw refuse(describe(status));
  for (const MYSOFA_ATTRIBUTE* at = sofa->attributes; at; at = at->next)
    if (at->name && at->value && std::string_view(at->name) == "DataType" && !std::string_view(at->value).starts_with("FIR"))
      throw refuse(fmt::format("has DataType '{}' instead of FIR", at->value));
  check_sizes(*sofa, refuse);

  SofaResponses responses;
  responses.sample_rate_hz = sofa->DataSamplingRate.values[0];
  responses.num_taps = static_cast<int>(sofa->N);
  place_sources(*sofa, refuse, responses);
  responses.taps.assign(sofa->DataIR.values, sofa->DataIR.values + sofa->DataIR.elements);
  responses.delay_samples.resize(2 * responses.direction.size());
  if (sofa->DataDelay.elements != 0)
    for (std::size_t i = 0; i < responses.delay_samples.size(); ++i)
      responses.delay_samples[i] = sofa->DataDelay.values[i % sofa->DataDelay.elements];
  validate(responses, name);
  if (second_is_left(*sofa, responses, refuse)) exchange_ears(responses);
  return responses;
}

void validate(const SofaResponses& responses, const std::string& where) {
  const auto refuse = [&](const std::string& problem) { return InputError(where, problem, kRemedy); };
  const std::size_t measurements = responses.direction.size();
  if (!(responses.sample_rate_hz >= kMinRateHz && responses.sample_rate_hz <= kMaxRateHz))
    throw refuse(fmt::format("has Data.SamplingRate {} Hz, outside [{}, {}]", responses.sample_rate_hz, kMinRateHz, kMaxRateHz));
  if (measurements < kMinDirections || measurements > kMaxDirections) throw refuse(fmt::format("has {} measurements (M)", measurements));
  if (responses.num_taps < 1 || responses.num_taps > static_cast<int>(kMaxTaps))
    throw refuse(fmt::format("has {} samples per response (N)", responses.num_taps));
  if (!responses.distance_m.empty() && responses.distance_m.size() != measurements)
    throw refuse(fmt::format("has {} distances in SourcePosition", responses.distance_m.size()));
  for (const float distance : responses.distance_m)
    if (!(distance > 0 && distance <= 1e6f)) throw refuse(fmt::format("has SourcePosition values at {} m", distance));
  if (responses.taps.size() != measurements * 2 * static_cast<std::size_t>(responses.num_taps))
    throw refuse(fmt::format("has {} values in Data.IR", responses.taps.size()));
  if (responses.delay_samples.size() != measurements * 2)
    throw refuse(fmt::format("has {} values in Data.Delay", responses.delay_samples.size()));
  for (std::size_t m = 0; m < measurements; ++m)
    if (!(std::abs(glm::length(responses.direction[m]) - 1.f) < 1e-3f))
      throw refuse(fmt::format("has no direction in SourcePosition {}", m));
  for (const float delay : responses.delay_samples)
    if (!(delay >= 0.f && delay <= static_cast<float>(kMaxTaps))) throw refuse(fmt::format("has Data.Delay {} samples", delay));
  float largest = 0;
  for (const float value : responses.taps) {
    if (!std::isfinite(value)) throw refuse("has non-finite values in Data.IR");
    largest = std::max(largest, std::abs(value));
  }
  if (!(largest > 0)) throw refuse("has only zeros in Data.IR");
}

std::string encode_responses(const SofaResponses& responses) {
  ByteWriter writer;
  writer.put(responses.sample_rate_hz);
  writer.put(responses.num_taps);
  writer.put_list(responses.direction);
  writer.put_list(responses.distance_m);
  writer.put_list(responses.taps);
  writer.put_list(responses.delay_samples);
  return writer.take();
}

SofaResponses decode_responses(std::string_view bytes, const std::string& where) {
  ByteReader reader(bytes, where);
  SofaResponses responses;
  responses.sample_rate_hz = reader.take<float>();
  responses.num_taps = reader.take<int>();
  responses.direction = reader.take_list<glm::vec3>();
  responses.distance_m = reader.take_list<float>();
  responses.taps = reader.take_list<float>();
  responses.delay_samples = reader.take_list<float>();
  reader.finish();
  validate(responses, where);
  return responses;
}

}  // namespace earshot
