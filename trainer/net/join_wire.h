#pragma once

#include <cstdint>
#include <msgpack.hpp>
#include <string>
#include <vector>

#include "trainer/net/wire.h"

namespace earshot {

/// A worker asks whoever listens at the meeting point to take part in a run that is under way.  The second field is a number where Hello
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

/// The answer to a JoinRequest.  The fields after briefing are those of an admission: the view that the members are about to leave, who
/// joins, and where each can be reached.
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
  std::int32_t meeting_rank = 0;           ///< who listens at the meeting point
  std::vector<std::string> control_endpoints, bulk_endpoints, public_keys;
  std::vector<std::uint32_t> incarnations;
  MSGPACK_DEFINE(version, kind, state, reason, briefing, run_key, epoch, members, joining, meeting_rank, control_endpoints, bulk_endpoints,
                 public_keys, incarnations)
};

}  // namespace earshot
