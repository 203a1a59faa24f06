#pragma once

#include <string>

#include "sim/base/text/config_reader.h"

namespace earshot {

/// What the others do when a worker is lost: end the run, or go on without it.
enum class OnLoss { stop, go_on };

/// How workers on several hosts reach each other: section `network` of a run config (docs/hosts.md).  Without any key, workers meet on one
/// host only.
struct NetworkConfig {
  std::string interface;       ///< where this worker listens: name (eth0) or address; empty: where the way to rank 0 begins
  std::string port_range;      ///< "FIRST-LAST"; empty: any free port, and 20000-29999 for a meeting point whose launcher names none
  std::string curve_key_file;  ///< this worker's CURVE keys (`earshot keys`), mode 0600
  std::string allow_list;      ///< file of public keys that may take part, one per line; empty: only the own one
  std::string meeting_key;     ///< public key of rank 0; empty: the own one, as all workers have the same file
  bool shared_memory = true;   ///< workers of one host add up gradients in memory that they share
  bool insecure = false;       ///< links that leave the host may go without keys
  OnLoss on_loss = OnLoss::stop;
  int restarts = 0;                 ///< how often `earshot train --workers N` starts a lost worker again, in one run
  double progress_timeout_s = 600;  ///< a worker that others wait for and that gets on in nothing for so long is lost
};

struct PortRange {
  int first = 0, last = 0;  ///< both 0: any
};

/// Throws InputError for a port range that is none.
PortRange ports_of(const NetworkConfig& config);

void read(ConfigReader& reader, NetworkConfig& config);
/// Throws InputError: a port range that is none, keys that are missing for what is asked, keys together with insecure.  Opens no file.
void validate(const NetworkConfig& config);

}  // namespace earshot
