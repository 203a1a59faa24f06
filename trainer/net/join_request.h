// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <zmq.hpp>

#include "trainer/net/link_security.h"
#include "trainer/net/ring_config.h"
#include "trainer/net/wire.h"

namespace earshot {

/// Briefing for a worker that wants to join, before it prepares its part (Collective::brief).  Throws InputError if it is refused
/// (the reason is the run's), RunError if no worker answers within config.timeout, or a signal asks this process to end.
std::string ask_for_briefing(const RingConfig& config);

/// Asks until it is admitted, however long the update under way takes, as long as the run answers.  Throws as above.  config: resolved;
/// with keys, the gate of `security` is open.
JoinAnswer ask_for_admission(zmq::context_t& context, const RingConfig& config, const std::string& control_endpoint,
                             const std::string& bulk_endpoint, const LinkSecurity& security);

/// A number that names one start of a worker; never 0.
std::uint32_t new_incarnation();

}  // namespace earshot
