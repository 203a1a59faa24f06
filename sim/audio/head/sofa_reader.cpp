#include "sim/audio/head/sofa_reader.h"

#include <fmt/format.h>
#include <mysofa.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>
#include <memory>
#include <string>
#include <string_view>

#include "sim/audio/transforms/resample.h"
#include "sim/base/byte_stream.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/process/isolated_call.h"

namespace earshot {
namespace {

constexpr std::size_t kMaxFileBytes = std::size_t{1} << 30;
constexpr unsigned kMinDirections = 8, kMaxDirections = 100000, kMaxTaps = 16384;
constexpr std::string_view kRemedy = "give a SimpleFreeFieldHRIR SOFA file";

struct FreeResponses {
  void operator()(MYSOFA_HRTF* responses) const noexcept { mysofa_free(responses); }
};

std::string describe(int status) {
  switch (status) {
    case MYSOFA_INVALID_FORMAT:
      return "is not a SOFA file, or a damaged one";
    case MYSOFA_UNSUPPORTED_FORMAT:
      return "is of a SOFA version or HDF5 layout that libmysofa cannot read";
    case MYSOFA_NO_MEMORY:
      return "needs more memory than there is: damaged?";
    case MYSOFA_READ_ERROR:
      return "ends too early";
    case MYSOFA_INVALID_ATTRIBUTES:
      return "lacks global attributes of AES69 (Conventions, DataType)";
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

}  // namespace

SofaResponses read_sofa(const std::filesystem::path& path) {
  const std::string where = path.string();
  const IsolationLimits limits = limits_for_file(path);
  return decode_responses(call_isolated(reader_program(), {"sofa", where}, where, limits), where);
}

SofaResponses parse_sofa(const std::filesystem::path& path) {
  const std::string name = path.string();
  const auto refuse = [&](const std::string& what) { return InputError(name, what, kRemedy); };
  const std::string bytes = read_file(path, kMaxFileBytes);
  // libmysofa 1.3 writes past its stack on files that end too early, so it is never given one.
  const std::uint64_t stated = stated_size(bytes);
  if (stated == 0) throw refuse(describe(MYSOFA_INVALID_FORMAT));
  if (stated > bytes.size()) throw refuse(fmt::format("ends too early: {} bytes of {}", bytes.size(), stated));
  int status = MYSOFA_OK;
  const std::unique_ptr<MYSOFA_HRTF, FreeResponses> sofa{mysofa_load_data(bytes.data(), bytes.size(), &status)};
  if (!sofa || status != MYSOFA_OK) throw refuse(describe(status));
  // Sizes first: mysofa_check reads the arrays and trusts them.
  if (sofa->R != 2) throw refuse(fmt::format("has {} receivers (R), not two ears", sofa->R));
  if (sofa->M < kMinDirections || sofa->M > kMaxDirections) throw refuse(fmt::format("has {} measurements (M)", sofa->M));
  if (sofa->N < 1 || sofa->N > kMaxTaps) throw refuse(fmt::format("has {} samples per response (N)", sofa->N));
  const auto measurements = static_cast<std::size_t>(sofa->M), taps = static_cast<std::size_t>(sofa->N);
  const auto expect_size = [&](const MYSOFA_ARRAY& array, std::size_t size, const char* field) {
    if (array.elements != size || !array.values) throw refuse(fmt::format("has {} values in {}, not {}", array.elements, field, size));
  };
  expect_size(sofa->DataIR, measurements * 2 * taps, "Data.IR");
  expect_size(sofa->SourcePosition, measurements * 3, "SourcePosition");
  expect_size(sofa->DataSamplingRate, 1, "Data.SamplingRate");
  if (sofa->ReceiverPosition.elements < 6 || !sofa->ReceiverPosition.values) throw refuse("has no ReceiverPosition for two ears");
  const bool shared_delay = sofa->DataDelay.elements == 2;
  if (sofa->DataDelay.elements != 0 && !shared_delay) expect_size(sofa->DataDelay, measurements * 2, "Data.Delay");
  status = mysofa_check(sofa.get());
  if (status != MYSOFA_OK) throw refuse(describe(status));
  mysofa_tocartesian(sofa.get());

  SofaResponses responses;
  responses.sample_rate_hz = sofa->DataSamplingRate.values[0];
  responses.num_taps = static_cast<int>(taps);
  // SOFA: x front, y left, z up.  Ears come left first, but some files name the right one first.
  const bool swapped = sofa->ReceiverPosition.values[1] < sofa->ReceiverPosition.values[4];
  responses.taps.resize(measurements * 2 * taps);
  for (std::size_t m = 0; m < measurements; ++m) {
    const float* position = sofa->SourcePosition.values + 3 * m;
    const glm::vec3 head(-position[1], position[2], -position[0]);
    const float length = glm::length(head);
    if (!(length > 1e-6f) || !std::isfinite(length)) throw refuse(fmt::format("has no direction in SourcePosition {}", m));
    responses.direction.push_back(head / length);
    responses.distance_m += length / static_cast<float>(measurements);
    for (std::size_t ear = 0; ear < 2; ++ear) {
      const std::size_t receiver = swapped ? 1 - ear : ear;
      std::copy_n(sofa->DataIR.values + (2 * m + receiver) * taps, taps,
                  responses.taps.begin() + static_cast<std::ptrdiff_t>((2 * m + ear) * taps));
      const float delay = sofa->DataDelay.elements == 0 ? 0.f : sofa->DataDelay.values[shared_delay ? receiver : 2 * m + receiver];
      responses.delay_samples.push_back(delay);
    }
  }
  validate(responses, name);
  return responses;
}

void validate(const SofaResponses& responses, const std::string& where) {
  const auto refuse = [&](const std::string& what) { return InputError(where, what, kRemedy); };
  const std::size_t measurements = responses.direction.size();
  if (!(responses.sample_rate_hz >= kMinRateHz && responses.sample_rate_hz <= kMaxRateHz))
    throw refuse(fmt::format("has Data.SamplingRate {} Hz, outside [{}, {}]", responses.sample_rate_hz, kMinRateHz, kMaxRateHz));
  if (measurements < kMinDirections || measurements > kMaxDirections) throw refuse(fmt::format("has {} measurements (M)", measurements));
  if (responses.num_taps < 1 || responses.num_taps > static_cast<int>(kMaxTaps))
    throw refuse(fmt::format("has {} samples per response (N)", responses.num_taps));
  if (!(responses.distance_m >= 0 && responses.distance_m <= 1e6f))
    throw refuse(fmt::format("has SourcePosition values at {} m", responses.distance_m));
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
    if (!std::isfinite(value)) throw refuse("has values in Data.IR that are not finite numbers");
    largest = std::max(largest, std::abs(value));
  }
  if (!(largest > 0)) throw refuse("has only zeros in Data.IR");
}

std::string encode_responses(const SofaResponses& responses) {
  ByteWriter writer;
  writer.put(responses.sample_rate_hz);
  writer.put(responses.num_taps);
  writer.put(responses.distance_m);
  writer.put_list(responses.direction);
  writer.put_list(responses.taps);
  writer.put_list(responses.delay_samples);
  return writer.take();
}

SofaResponses decode_responses(std::string_view bytes, const std::string& where) {
  ByteReader reader(bytes, where);
  SofaResponses responses;
  responses.sample_rate_hz = reader.take<float>();
  responses.num_taps = reader.take<int>();
  responses.distance_m = reader.take<float>();
  responses.direction = reader.take_list<glm::vec3>();
  responses.taps = reader.take_list<float>();
  responses.delay_samples = reader.take_list<float>();
  reader.finish();
  validate(responses, where);
  return responses;
}

}  // namespace earshot
