// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <msgpack.hpp>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "sim/base/errors.h"
#include "trainer/net/ring_config.h"

namespace earshot {

/// An invalid message: too large, truncated, of another type or version.  Never leaves trainer/: the receiver decides whether the sender is
/// an unknown peer or a peer of another build.
class WireError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The error for an invalid message of a worker.
[[nodiscard]] RunError protocol_breach(int rank, const WireError& error);

inline constexpr std::uint16_t kWireVersion = 6;
inline constexpr std::size_t kMaxControlBytes = 64 * 1024;  ///< of one control message
inline constexpr std::size_t kChunkBytes =
    std::size_t{1} << 20;  ///< payload of one bulk message (docs/explanation/ppo.md, section 6.3: 1 MiB was the fastest)

inline constexpr std::size_t kMaxGatherBytes = std::size_t{1} << 30;  ///< of one worker's part: bounds what a peer can make us allocate

/// A worker introduces itself to rank 0.
struct Hello {
  static constexpr std::size_t kFields = 7;
  std::uint16_t version = kWireVersion;
  std::string run_id;
  std::int32_t rank = 0, world_size = 0;
  std::string control_endpoint, bulk_endpoint;
  std::string public_key;                                                                         ///< of CURVE; empty without
  MSGPACK_DEFINE(version, run_id, rank, world_size, control_endpoint, bulk_endpoint, public_key)  // append fields, never reorder
};

/// Rank 0's answer: the table of all endpoints by rank, or why the worker is refused.
struct Welcome {
  static constexpr std::size_t kFields = 6;
  std::uint16_t version = kWireVersion;
  std::string refusal;        ///< empty: accepted
  std::uint64_t run_key = 0;  ///< fresh per start; makes this run's routing ids and frames its own
  std::vector<std::string> control_endpoints, bulk_endpoints;
  std::vector<std::string> public_keys;  ///< of CURVE, by rank; empty texts without
  MSGPACK_DEFINE(version, refusal, run_key, control_endpoints, bulk_endpoints, public_keys)
};

/// The last message of a worker to its peers.
struct Goodbye {
  static constexpr std::size_t kFields = 2;
  std::uint16_t version = kWireVersion;
  std::string reason;  ///< empty: it has finished
  MSGPACK_DEFINE(version, reason)
};

/// The workers that are to be left, as one of them proposes (membership.h).
struct ViewMessage {
  static constexpr std::size_t kFields = 3;
  std::uint16_t version = kWireVersion;
  std::uint32_t epoch = 0;
  std::uint64_t members = 0;  ///< bit r: the worker that began as rank r
  MSGPACK_DEFINE(version, epoch, members)
};

/// A worker's request to the listener of the meeting point to join a run under way.  The second field is a number where Hello
/// has a text: neither is taken for the other.
struct JoinRequest {
  static constexpr std::size_t kFields = 11;
  std::uint16_t version = kWireVersion;
  std::uint8_t kind = 1;
  std::string run_id;
  std::int32_t rank = 0, world_size = 0;
  std::uint32_t incarnation = 0;                ///< RingConfig::incarnation
  std::string control_endpoint, bulk_endpoint;  ///< empty as long as it only asks for the briefing
  std::string public_key;                       ///< of CURVE; empty without
  std::string engine, settings;                 ///< RingConfig's
  MSGPACK_DEFINE(version, kind, run_id, rank, world_size, incarnation, control_endpoint, bulk_endpoint, public_key, engine,
                 settings)  // append fields, never reorder
  [[nodiscard]] bool is_ready() const { return !control_endpoint.empty(); }
};

/// A worker that is to join, as all members come to know it.
struct Candidate {
  std::int32_t rank = 0;
  std::uint32_t incarnation = 0;
  std::string control_endpoint, bulk_endpoint, public_key;
  MSGPACK_DEFINE(rank, incarnation, control_endpoint, bulk_endpoint, public_key)
};

/// Those that are to join at one update boundary.
struct CandidateList {
  static constexpr std::size_t kFields = 2;
  std::uint16_t version = kWireVersion;
  std::vector<Candidate> candidates;
  MSGPACK_DEFINE(version, candidates)
};

enum class JoinState : std::uint8_t { refused, waits, admitted };

/// The answer to a JoinRequest.  The fields after briefing are those of an admission: the view that the members are about to leave, the
/// joining workers, and the address of each.
struct JoinAnswer {
  static constexpr std::size_t kFields = 14;
  std::uint16_t version = kWireVersion;
  std::uint8_t kind = 1;
  std::uint8_t state = 0;  ///< JoinState
  std::string reason;      ///< why it is refused, or has to wait
  std::string briefing;    ///< Collective::brief
  std::uint64_t run_key = 0;
  std::uint32_t epoch = 0;
  std::uint64_t members = 0, joining = 0;  ///< bit r: rank r
  std::int32_t meeting_rank = 0;           ///< rank that listens at the meeting point
  std::vector<std::string> control_endpoints, bulk_endpoints, public_keys;
  std::vector<std::uint32_t> incarnations;
  MSGPACK_DEFINE(version, kind, state, reason, briefing, run_key, epoch, members, joining, meeting_rank, control_endpoints, bulk_endpoints,
                 public_keys, incarnations)
};

template <class T>
std::string encode(const T& message) {
  msgpack::sbuffer buffer;
  msgpack::pack(buffer, message);
  return {buffer.data(), buffer.size()};
}

/// One whole MessagePack array, nothing before or after it; every length inside is bounded by the message itself, so a forged length cannot
/// make it allocate.  The version comes first and is checked before the rest is read.
template <class T>
T decode(std::string_view bytes, std::size_t max_bytes = kMaxControlBytes) {
  if (bytes.size() > max_bytes) throw WireError("control message of " + std::to_string(bytes.size()) + " bytes");
  try {
    std::size_t offset = 0;
    const std::size_t limit = bytes.size();
    const msgpack::object_handle handle =
        msgpack::unpack(bytes.data(), bytes.size(), offset, nullptr, nullptr, msgpack::unpack_limit(limit, limit, limit, limit, limit, 8));
    if (offset != bytes.size()) throw WireError("extra bytes at the end of a control message");
    const msgpack::object& object = handle.get();
    if (object.type != msgpack::type::ARRAY || object.via.array.size == 0) throw WireError("control message is not a list");
    const auto version = object.via.array.ptr[0].as<std::uint64_t>();
    if (version != kWireVersion)
      throw WireError("protocol version " + std::to_string(version) + ", this program uses " + std::to_string(kWireVersion));
    T message;
    if (object.via.array.size < T::kFields) throw WireError("control message with missing fields");
    object.convert(message);
    return message;
  } catch (const WireError&) {
    throw;
  } catch (const std::exception& error) {  // msgpack throws several unrelated types
    throw WireError(std::string("malformed control message: ") + error.what());
  }
}

/// Call and chunk of a data message.
enum class Operation : std::uint8_t {
  all_reduce_float,
  all_reduce_double,
  broadcast,
  barrier,
  all_gather,
  goodbye,
  view,      ///< a ViewMessage
  progress,  ///< the sender gets on (phase 0, total: how far) or waits for others (phase 1)
  hand_over  ///< the state of the run, to workers that have joined
};
const char* name_of(Operation operation);

/// Header frame of every message between workers: 64 bytes, little-endian, followed by one payload frame.
struct FrameHeader {
  Operation operation = Operation::barrier;
  std::uint8_t phase = 0;  ///< 0 data on the way (reduce-scatter), 1 results on the way (all-gather)
  std::uint64_t run_key = 0;
  std::uint64_t sequence = 0;  ///< number of the collective call
  std::uint32_t step = 0, segment = 0;
  std::uint64_t offset = 0;  ///< in bytes, from the start of the buffer
  std::uint64_t length = 0;  ///< of the payload
  std::uint64_t total = 0;   ///< of the whole buffer
  std::uint32_t epoch = 0;   ///< of the membership (membership.h)
  friend bool operator==(const FrameHeader&, const FrameHeader&) = default;
};
inline constexpr std::size_t kHeaderBytes = 64;
std::array<std::byte, kHeaderBytes> encode_header(const FrameHeader& header);
/// Throws WireError: size, magic, version, unknown operation, lengths that cannot be.
FrameHeader decode_header(std::span<const std::byte> bytes);

}  // namespace earshot
