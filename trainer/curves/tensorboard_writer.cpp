// SPDX-License-Identifier: Apache-2.0
#include "trainer/curves/tensorboard_writer.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <bit>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <system_error>

#include "sim/base/errors.h"
#include "sim/base/text/log.h"

namespace earshot {
namespace {

constexpr std::array<std::uint32_t, 256> make_crc_table() {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t byte = 0; byte < 256; ++byte) {
    std::uint32_t crc = byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ ((crc & 1) != 0 ? 0x82F63B78u : 0u);  // reflected polynomial 0x1EDC6F41
    table[byte] = crc;
  }
  return table;
}
constexpr auto kCrcTable = make_crc_table();

/// Protobuf wire format: fields of the kinds that Event and Summary use.
class ProtobufMessage {
 public:
  void add_varint(int field, std::uint64_t value) {
    put_key(field, 0);
    put_varint(value);
  }
  void add_double(int field, double value) {
    put_key(field, 1);
    put_little_endian(std::bit_cast<std::uint64_t>(value));
  }
  void add_float(int field, float value) {
    put_key(field, 5);
    put_little_endian(std::bit_cast<std::uint32_t>(value));
  }
  void add_bytes(int field, std::string_view value) {
    put_key(field, 2);
    put_varint(value.size());
    bytes_ += value;
  }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }

 private:
  void put_key(int field, int type) { put_varint(static_cast<std::uint64_t>(field) << 3 | static_cast<std::uint64_t>(type)); }
  void put_varint(std::uint64_t value) {
    for (; value >= 0x80; value >>= 7) bytes_ += static_cast<char>((value & 0x7F) | 0x80);
    bytes_ += static_cast<char>(value);
  }
  template <class T>
  void put_little_endian(T value) {
    for (std::size_t i = 0; i < sizeof(T); ++i) bytes_ += static_cast<char>(value >> (8 * i) & 0xFF);
  }

  std::string bytes_;
};

// Field numbers of tensorflow/core/util/event.proto and framework/summary.proto.
namespace event_field {
constexpr int wall_time = 1, step = 2, file_version = 3, summary = 5, session_log = 7;
}
namespace summary_field {
constexpr int value = 1, tag = 1, simple_value = 2;
}
constexpr int kSessionStatus = 1, kSessionStart = 1;

double seconds_since_1970() { return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count(); }

ProtobufMessage new_event(std::int64_t step) {
  ProtobufMessage event;
  event.add_double(event_field::wall_time, seconds_since_1970());
  event.add_varint(event_field::step, static_cast<std::uint64_t>(step));
  return event;
}

std::string host_name() {
  std::array<char, 256> name{};
  return ::gethostname(name.data(), name.size() - 1) == 0 && name[0] != '\0' ? std::string(name.data()) : "localhost";
}

}  // namespace

std::uint32_t crc32c(std::string_view bytes) {
  std::uint32_t crc = 0xFFFFFFFFu;
  for (const char byte : bytes) crc = (crc >> 8) ^ kCrcTable[(crc ^ static_cast<unsigned char>(byte)) & 0xFF];
  return ~crc;
}

std::uint32_t masked_crc32c(std::string_view bytes) { return std::rotr(crc32c(bytes), 15) + 0xA282EAD8u; }

TensorBoardWriter::TensorBoardWriter(const std::filesystem::path& folder, std::optional<std::int64_t> discard_from_step) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw RunError(folder.string(), "cannot be created: " + error.message());
  // TensorBoard reads the files of a folder in the order of their names: seconds first, then what tells two starts within a second apart.
  const auto seconds = static_cast<std::uint64_t>(seconds_since_1970());
  for (int attempt = 0; descriptor_ < 0; ++attempt) {
    path_ = folder / fmt::format("events.out.tfevents.{:010}.{}.{}.{}", seconds, host_name(), ::getpid(), attempt);
    descriptor_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_APPEND | O_CLOEXEC, 0644);
    if (descriptor_ < 0 && (errno != EEXIST || attempt > 1000))
      throw RunError(path_.string(), "cannot be created: " + std::generic_category().message(errno));
  }
  ProtobufMessage version;
  version.add_double(event_field::wall_time, seconds_since_1970());
  version.add_bytes(event_field::file_version, "brain.Event:2");
  write_record(version.bytes());
  if (discard_from_step) {
    ProtobufMessage session, event = new_event(*discard_from_step);
    session.add_varint(kSessionStatus, kSessionStart);
    event.add_bytes(event_field::session_log, session.bytes());
    write_record(event.bytes());
  }
}

TensorBoardWriter::~TensorBoardWriter() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

void TensorBoardWriter::write(std::int64_t step, std::span<const std::pair<std::string, double>> scalars) {
  ProtobufMessage summary;
  for (const auto& [name, value] : scalars) {
    if (!std::isfinite(value)) continue;
    ProtobufMessage scalar;
    scalar.add_bytes(summary_field::tag, name);
    scalar.add_float(summary_field::simple_value, static_cast<float>(value));
    summary.add_bytes(summary_field::value, scalar.bytes());
  }
  ProtobufMessage event = new_event(step);
  event.add_bytes(event_field::summary, summary.bytes());
  write_record(event.bytes());
}

void TensorBoardWriter::write_record(std::string_view event) {
  const auto little_endian = [](auto value) {
    std::string bytes;
    for (std::size_t i = 0; i < sizeof(value); ++i) bytes += static_cast<char>(value >> (8 * i) & 0xFF);
    return bytes;
  };
  std::string record = little_endian(static_cast<std::uint64_t>(event.size()));
  record += little_endian(masked_crc32c(record));
  record += event;
  record += little_endian(masked_crc32c(event));
  const off_t whole = ::lseek(descriptor_, 0, SEEK_END);
  std::string_view rest = record;
  while (!rest.empty()) {
    const ssize_t written = ::write(descriptor_, rest.data(), rest.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) {
      const std::string reason = std::generic_category().message(errno);
      // Readers stop at a torn record: on a full disk the file ends with its last whole one.
      if (whole < 0 || ::ftruncate(descriptor_, whole) != 0) log_warning(fmt::format("{} ends with an incomplete record", path_.string()));
      throw RunError(path_.string(), "cannot be written: " + reason);
    }
    rest.remove_prefix(static_cast<std::size_t>(written));
  }
}

}  // namespace earshot
