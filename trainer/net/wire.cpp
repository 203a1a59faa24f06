// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/wire.h"

#include <fmt/format.h>

#include <bit>
#include <cstring>

namespace earshot {
namespace {

static_assert(std::endian::native == std::endian::little, "frames and checkpoints are written as they lie in memory");

constexpr std::uint32_t kMagic = 0x53524145;  // "EARS"
constexpr std::uint8_t kLastOperation = static_cast<std::uint8_t>(Operation::hand_over);

}  // namespace

RunError protocol_breach(int rank, const WireError& error) {
  return {worker_name(rank), fmt::format("breaks the protocol: {}", error.what())};
}

const char* name_of(Operation operation) {
  switch (operation) {
    case Operation::all_reduce_float:
      return "all_reduce_sum of floats";
    case Operation::all_reduce_double:
      return "all_reduce_sum of doubles";
    case Operation::broadcast:
      return "broadcast";
    case Operation::barrier:
      return "barrier";
    case Operation::all_gather:
      return "all_gather";
    case Operation::goodbye:
      return "goodbye";
    case Operation::view:
      return "view";
    case Operation::progress:
      return "progress";
    case Operation::hand_over:
      return "hand_over";
  }
  return "unknown operation";
}

std::array<std::byte, kHeaderBytes> encode_header(const FrameHeader& header) {
  std::array<std::byte, kHeaderBytes> bytes{};
  std::size_t at = 0;
  const auto put = [&](auto value) {
    std::memcpy(bytes.data() + at, &value, sizeof(value));
    at += sizeof(value);
  };
  put(kMagic);
  put(kWireVersion);
  put(static_cast<std::uint8_t>(header.operation));
  put(header.phase);
  put(header.run_key);
  put(header.sequence);
  put(header.step);
  put(header.segment);
  put(header.offset);
  put(header.length);
  put(header.total);
  put(header.epoch);
  return bytes;
}

FrameHeader decode_header(std::span<const std::byte> bytes) {
  if (bytes.size() != kHeaderBytes) throw WireError("frame header of " + std::to_string(bytes.size()) + " bytes");
  std::size_t at = 0;
  const auto take = [&]<class T>(T& value) {
    std::memcpy(&value, bytes.data() + at, sizeof(value));
    at += sizeof(value);
  };
  std::uint32_t magic = 0;
  std::uint16_t version = 0;
  std::uint8_t operation = 0;
  FrameHeader header;
  take(magic);
  take(version);
  if (magic != kMagic) throw WireError("frame without the magic number");
  if (version != kWireVersion)
    throw WireError("frame with protocol version " + std::to_string(version) + ", this program uses " + std::to_string(kWireVersion));
  take(operation);
  if (operation > kLastOperation) throw WireError("frame with unknown operation " + std::to_string(operation));
  header.operation = static_cast<Operation>(operation);
  take(header.phase);
  take(header.run_key);
  take(header.sequence);
  take(header.step);
  take(header.segment);
  take(header.offset);
  take(header.length);
  take(header.total);
  take(header.epoch);
  if (header.length > kChunkBytes || header.offset > header.total || header.length > header.total - header.offset)
    throw WireError("frame with invalid lengths");
  return header;
}

}  // namespace earshot
