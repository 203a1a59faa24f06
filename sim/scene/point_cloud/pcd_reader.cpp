// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/point_cloud/pcd_reader.h"

#include <fmt/format.h>

#include <array>
#include <cstdint>
#include <optional>

#include "sim/base/errors.h"
#include "sim/scene/point_cloud/binary_number.h"
#include "sim/scene/point_cloud/lzf.h"
#include "sim/scene/readers/mesh_builder.h"
#include "sim/scene/readers/text_scanner.h"

namespace earshot {
namespace {

/// Times kMaxPoints, far below what 64 bits hold.
constexpr std::size_t kMaxRecordBytes = std::size_t{1} << 20;

struct PcdField {
  std::string name;
  std::size_t size = 0, count = 1;  ///< bytes of a number, numbers of a point
  char type = 'F';
};

template <class Signed, class Unsigned>
double pcd_integer(std::string_view bytes, std::size_t at, char type) {
  return type == 'I' ? static_cast<double>(little_endian<Signed>(bytes, at)) : static_cast<double>(little_endian<Unsigned>(bytes, at));
}

double pcd_number(std::string_view bytes, std::size_t at, const PcdField& field) {
  if (field.type == 'F') return field.size == 4 ? double{little_endian<float>(bytes, at)} : little_endian<double>(bytes, at);
  switch (field.size) {
    case 1:
      return pcd_integer<std::int8_t, std::uint8_t>(bytes, at, field.type);
    case 2:
      return pcd_integer<std::int16_t, std::uint16_t>(bytes, at, field.type);
    case 4:
      return pcd_integer<std::int32_t, std::uint32_t>(bytes, at, field.type);
    default:
      return pcd_integer<std::int64_t, std::uint64_t>(bytes, at, field.type);
  }
}

class PcdParser {
 public:
  PcdParser(std::string_view bytes, const std::string& where) : bytes_(bytes), where_(where), lines_(bytes) {}

  PointCloud parse() {
    read_header();
    check_header();
    if (data_ == "ascii")
      read_text();
    else if (data_ == "binary")
      read_binary();
    else if (data_ == "binary_compressed")
      read_compressed();
    else
      fail(fmt::format("has DATA {}, and ascii, binary and binary_compressed are read", one_line(data_)));
    return std::move(cloud_);
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const {
    throw InputError(where_, problem, "check the file, or export it again as a PCD with the fields x, y and z");
  }

  std::size_t whole(std::string_view word, std::int64_t largest) const {
    const auto value = parse_whole(word);
    if (!value || *value < 0 || *value > largest)
      fail(fmt::format("PCD header line {}: '{}' is not a valid number", lines_.number(), one_line(std::string(word))));
    return static_cast<std::size_t>(*value);
  }

  void read_header() {
    constexpr std::size_t kMaxLines = 1000;
    while (lines_.number() < kMaxLines && lines_.next()) {
      std::string_view line = lines_.line();
      split_words(line, words_);
      if (words_.empty() || words_[0].front() == '#') continue;
      take_line();
      if (words_[0] == "DATA") return;
    }
    fail(lines_.number() == 0 || fields_.empty() ? "is not a PCD file" : "PCD header has no line DATA");
  }

  void take_line() {
    const std::string_view key = words_[0];
    if (key == "FIELDS" || key == "COLUMNS") {
      for (std::size_t i = 1; i < words_.size(); ++i) fields_.push_back({.name = std::string(words_[i])});
    } else if (key == "SIZE" || key == "TYPE" || key == "COUNT") {
      if (words_.size() != fields_.size() + 1)
        fail(fmt::format("PCD header line {} has {} entries for {} fields", lines_.number(), words_.size() - 1, fields_.size()));
      for (std::size_t i = 0; i < fields_.size(); ++i) {
        if (key == "TYPE")
          fields_[i].type = words_[i + 1].front();
        else
          (key == "SIZE" ? fields_[i].size : fields_[i].count) = whole(words_[i + 1], 1 << 20);
      }
    } else if (key == "WIDTH" || key == "HEIGHT" || key == "POINTS") {
      if (words_.size() != 2) fail(fmt::format("PCD header line {} is not valid", lines_.number()));
      (key == "WIDTH" ? width_ : key == "HEIGHT" ? height_ : points_) = whole(words_[1], std::int64_t{1} << 40);
    } else if (key == "DATA") {
      if (words_.size() != 2) fail(fmt::format("PCD header line {} is not valid", lines_.number()));
      data_ = words_[1];
    } else if (key != "VERSION" && key != "VIEWPOINT") {
      fail(lines_.number() == 1 ? "is not a PCD file"
                                : fmt::format("PCD header line {} begins with '{}'", lines_.number(), one_line(std::string(key))));
    }
  }

  void check_header() {
    std::array<bool, 3> has{};
    for (const PcdField& field : fields_) {
      const bool is_valid = field.type == 'F' ? field.size == 4 || field.size == 8
                                              : (field.type == 'I' || field.type == 'U') &&
                                                    (field.size == 1 || field.size == 2 || field.size == 4 || field.size == 8);
      if (!is_valid) fail(fmt::format("field '{}' has the type {} of {} bytes", one_line(field.name), field.type, field.size));
      for (std::size_t axis = 0; axis < 3; ++axis) {
        if (field.name != std::string(1, static_cast<char>('x' + axis))) continue;
        if (has[axis] || field.count != 1) fail(fmt::format("has more than one {} per point", field.name));
        has[axis] = true;
        axis_of_[axis] = static_cast<std::size_t>(&field - fields_.data());
      }
      record_bytes_ += field.size * field.count;
      if (record_bytes_ > kMaxRecordBytes) fail(fmt::format("has more than {} bytes per point", kMaxRecordBytes));
      record_numbers_ += field.count;
    }
    if (!(has[0] && has[1] && has[2])) fail("has no fields x, y and z");
    if (!width_ && !points_) fail("declares no number of points");
    const std::uint64_t product = width_.value_or(0) > kMaxPoints || height_.value_or(1) > kMaxPoints
                                      ? std::uint64_t{kMaxPoints} + 1
                                      : std::uint64_t{width_.value_or(0)} * height_.value_or(1);
    count_ = points_ ? *points_ : product;
    require_point_count(count_, where_);
    if (width_ && points_ && product != count_)
      fail(fmt::format("declares {} points, but WIDTH {} and HEIGHT {}", count_, *width_, height_.value_or(1)));
  }

  [[nodiscard]] std::size_t offset_of(std::size_t field) const {
    std::size_t offset = 0;
    for (std::size_t i = 0; i < field; ++i) offset += fields_[i].size * fields_[i].count;
    return offset;
  }

  void read_text() {
    std::array<std::size_t, 3> column{};
    for (std::size_t axis = 0; axis < 3; ++axis)
      for (std::size_t i = 0; i < axis_of_[axis]; ++i) column[axis] += fields_[i].count;
    while (lines_.next()) {
      split_words(lines_.line(), words_);
      if (words_.empty() || words_[0].front() == '#') continue;
      if (cloud_.positions.size() == count_) fail(fmt::format("line {} comes after the last point of the PCD header", lines_.number()));
      if (words_.size() != record_numbers_)
        fail(fmt::format("line {} has {} numbers, and a point has {}", lines_.number(), words_.size(), record_numbers_));
      glm::dvec3 position;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto value = parse_decimal(words_[column[axis]]);
        if (!value) fail(fmt::format("line {}: '{}' is not a number", lines_.number(), one_line(std::string(words_[column[axis]]))));
        position[static_cast<glm::length_t>(axis)] = *value;
      }
      cloud_.positions.push_back(position);
    }
    if (cloud_.positions.size() != count_) fail(fmt::format("ends after {} of {} points", cloud_.positions.size(), count_));
  }

  void read_binary() {
    const std::string_view body = bytes_.substr(lines_.offset());
    if (body.size() / record_bytes_ < count_) fail(fmt::format("ends before the {} points that its PCD header declares", count_));
    cloud_.positions.resize(count_);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::size_t offset = offset_of(axis_of_[axis]);
      for (std::size_t i = 0; i < count_; ++i)
        cloud_.positions[i][static_cast<glm::length_t>(axis)] = pcd_number(body, i * record_bytes_ + offset, fields_[axis_of_[axis]]);
    }
    if (body.size() > count_ * record_bytes_)
      cloud_.warnings.push_back(fmt::format("{} extra bytes after the last point of the PCD header", body.size() - count_ * record_bytes_));
  }

  void read_compressed() {
    const std::string_view body = bytes_.substr(lines_.offset());
    if (body.size() < 8) fail("ends before its compressed points");
    const std::size_t packed_bytes = little_endian<std::uint32_t>(body, 0), size = little_endian<std::uint32_t>(body, 4);
    if (packed_bytes > body.size() - 8) fail("ends before its compressed points");
    if (size != count_ * record_bytes_) fail(fmt::format("holds {} bytes for {} points of {} bytes", size, count_, record_bytes_));
    const std::optional<std::string> fields = expand_lzf(body.substr(8, packed_bytes), size);
    if (!fields) fail("holds compressed points that cannot be expanded");
    cloud_.positions.resize(count_);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const PcdField& field = fields_[axis_of_[axis]];
      const std::size_t begin = offset_of(axis_of_[axis]) * count_;
      for (std::size_t i = 0; i < count_; ++i)
        cloud_.positions[i][static_cast<glm::length_t>(axis)] = pcd_number(*fields, begin + i * field.size, field);
    }
  }

  std::string_view bytes_;
  const std::string& where_;
  LineScanner lines_;
  std::vector<std::string_view> words_;
  std::vector<PcdField> fields_;
  std::optional<std::size_t> width_, height_, points_;
  std::string data_;
  std::array<std::size_t, 3> axis_of_{};
  std::size_t record_bytes_ = 0, record_numbers_ = 0;
  std::uint64_t count_ = 0;
  PointCloud cloud_;
};

}  // namespace

PointCloud parse_pcd(std::string_view bytes, const std::string& where) { return PcdParser(bytes, where).parse(); }

}  // namespace earshot
