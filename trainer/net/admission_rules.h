// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "trainer/net/membership.h"
#include "trainer/net/ring_config.h"
#include "trainer/net/wire.h"

namespace earshot {

/// Rules for messages between workers that are not connected yet: functions of the message and the config alone.  The proof of a key is
/// LinkSecurity's.

/// Whether a worker may listen there: an endpoint in a message may only lead where this worker would listen itself.
[[nodiscard]] bool is_possible_endpoint(const RingConfig& config, const std::string& endpoint);

/// The reason to refuse a worker of the first world, or one that joins; empty if there is none.
[[nodiscard]] std::string objection_to(const Hello& hello, const RingConfig& config);
[[nodiscard]] std::string objection_to(const JoinRequest& request, const RingConfig& config);

/// Throw WireError for an admission of this worker that breaks the protocol, and for candidates that are members or are no ranks of the
/// run.
void check(const JoinAnswer& admission, const RingConfig& config, bool encrypted);
void check(const CandidateList& list, const View& view, int world_size);

}  // namespace earshot
