// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/point_cloud/las_reader.h"

#include <fmt/format.h>

#include <array>
#include <cmath>

#include "sim/base/errors.h"
#include "sim/scene/point_cloud/binary_number.h"

namespace earshot {
namespace {

/// Bytes of a record of each point format (LAS 1.4 R15, tables 7 to 17), without extra bytes.
constexpr std::array<std::size_t, 11> kRecordBytes{20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
constexpr std::size_t kSmallestHeader = 227, kHeader14 = 375;

struct LasHeader {
  std::size_t format = 0, record_bytes = 0, first = 0;
  std::uint64_t count = 0;
  glm::dvec3 scale{1}, offset{0};
};

[[noreturn]] void fail_las(const std::string& where, const std::string& problem) {
  throw InputError(where, problem, "check the file, or export it again as LAS 1.2 to 1.4");
}

LasHeader read_las_header(std::string_view bytes, const std::string& where) {
  if (!bytes.starts_with("LASF")) fail_las(where, "is not a LAS file");
  if (bytes.size() < kSmallestHeader) fail_las(where, "ends within its LAS header");
  const int major = static_cast<unsigned char>(bytes[24]), minor = static_cast<unsigned char>(bytes[25]);
  if (major != 1 || minor > 4) fail_las(where, fmt::format("is of LAS version {}.{}, and 1.0 to 1.4 are read", major, minor));
  const auto format = static_cast<unsigned char>(bytes[104]);
  if ((format & 0xC0) != 0)
    throw InputError(where, "holds compressed points (LAZ), which are not read", "convert it to LAS without compression");
  LasHeader header;
  header.format = format;
  if (header.format >= kRecordBytes.size()) fail_las(where, fmt::format("has point format {}, and 0 to 10 are read", header.format));
  header.record_bytes = little_endian<std::uint16_t>(bytes, 105);
  if (header.record_bytes < kRecordBytes[header.format])
    fail_las(where, fmt::format("has records of {} bytes, too few for point format {}", header.record_bytes, header.format));
  header.first = little_endian<std::uint32_t>(bytes, 96);
  header.count = little_endian<std::uint32_t>(bytes, 107);
  if (minor == 4) {
    if (bytes.size() < kHeader14) fail_las(where, "ends within its LAS header");
    header.count = little_endian<std::uint64_t>(bytes, 247);
  }
  for (int axis = 0; axis < 3; ++axis) {
    header.scale[axis] = little_endian<double>(bytes, 131 + 8 * static_cast<std::size_t>(axis));
    header.offset[axis] = little_endian<double>(bytes, 155 + 8 * static_cast<std::size_t>(axis));
    if (!std::isfinite(header.scale[axis]) || header.scale[axis] == 0 || !std::isfinite(header.offset[axis]))
      fail_las(where, fmt::format("has the scale {} and the offset {}", header.scale[axis], header.offset[axis]));
  }
  require_point_count(header.count, where);
  if (header.first < kSmallestHeader || header.first > bytes.size() || header.count > (bytes.size() - header.first) / header.record_bytes)
    fail_las(where, fmt::format("ends before the {} points that its LAS header declares", header.count));
  return header;
}

bool is_withheld(std::string_view record, std::size_t format) {
  const auto byte = [&](std::size_t at) { return static_cast<unsigned char>(record[at]); };
  const bool is_extended = format >= 6;
  const bool withheld = is_extended ? (byte(15) & 4) != 0 : (byte(15) & 0x80) != 0;
  const int classification = is_extended ? byte(16) : byte(15) & 31;
  return withheld || classification == 7 || (is_extended && classification == 18);
}

}  // namespace

PointCloud parse_las(std::string_view bytes, const std::string& where) {
  const LasHeader header = read_las_header(bytes, where);
  PointCloud cloud;
  cloud.positions.reserve(header.count);
  for (std::uint64_t i = 0; i < header.count; ++i) {
    const std::string_view record = bytes.substr(header.first + i * header.record_bytes, header.record_bytes);
    if (is_withheld(record, header.format)) {
      ++cloud.num_invalid;
      continue;
    }
    const glm::dvec3 raw(little_endian<std::int32_t>(record, 0), little_endian<std::int32_t>(record, 4),
                         little_endian<std::int32_t>(record, 8));
    cloud.positions.push_back(raw * header.scale + header.offset);
  }
  return cloud;
}

}  // namespace earshot
