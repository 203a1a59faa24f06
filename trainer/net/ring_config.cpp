// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/ring_config.h"

#include <fmt/format.h>

#include <charconv>

#include "sim/base/text/config_reader.h"
#include "trainer/net/curve_keys.h"

namespace earshot {

PortRange ports_of(const NetworkConfig& config) {
  const std::string& text = config.port_range;
  if (text.empty()) return {};
  PortRange range;
  const char* const end = text.data() + text.size();
  const auto [dash, first_error] = std::from_chars(text.data(), end, range.first);
  bool parsed = first_error == std::errc() && dash != end && *dash == '-';
  if (parsed) {
    const auto [last, last_error] = std::from_chars(dash + 1, end, range.last);
    parsed = last_error == std::errc() && last == end;
  }
  require(parsed && range.first >= 1 && range.last <= 65535 && range.last >= range.first, "network.port_range", text,
          "must be FIRST-LAST with 1 <= FIRST <= LAST <= 65535");
  return range;
}

void read(ConfigReader& reader, NetworkConfig& config) {
  reader.read_choice<Transport>(
      "collective", config.collective,
      {{"auto", Transport::automatic}, {"zeromq", Transport::zeromq}, {"mpi", Transport::mpi}, {"gloo", Transport::gloo}},
      "Connection of the workers. auto: zeromq up to 64 workers; beyond, mpi under mpirun and srun --mpi=pmix, else gloo. Same bits.");
  reader.read("interface", config.interface, Allowed::text("the name or address of an interface"),
              "Interface that this worker listens on, such as eth0 or an address. Empty: the one that leads to rank 0.");
  reader.read("port_range", config.port_range, Allowed::text("FIRST-LAST, ports from 1 to 65535"),
              "Ports to listen on. Empty: any free port, and 20000-29999 for a meeting point whose launcher names none.");
  reader.read("curve_key_file", config.curve_key_file, Allowed::text("a key file"),
              "CURVE keys of this worker, a file of mode 0600 made by earshot keys.");
  reader.read("allow_list", config.allow_list, Allowed::text("a file of public keys"),
              "Public keys that may take part, one per line. Empty: the worker's own key only.");
  reader.read("meeting_key", config.meeting_key, Allowed::text("a public key, 40 characters"),
              "Public key of rank 0. Empty: the worker's own key, where all workers share a key file.");
  reader.read("shared_memory", config.shared_memory, "Workers of one host sum gradients in shared memory.");
  reader.read("insecure", config.insecure, "Allows links between hosts without keys.");
  reader.read_choice<OnLoss>("on_loss", config.on_loss, {{"stop", OnLoss::stop}, {"continue", OnLoss::go_on}},
                             "Reaction to a lost worker. stop: the run ends with a checkpoint. continue: the others go on.");
  reader.read("restarts", config.restarts, Allowed::between(0, 1'000'000),
              "Number of times that earshot train --workers N restarts lost workers in one run.");
  reader.read("progress_timeout_s", config.progress_timeout_s, Allowed::between(0.1, 1e6),
              "Time without progress after which a worker counts as lost.");
}

void validate(const NetworkConfig& config) {
  check_values(config, "network");
  ports_of(config);
  const bool library = config.collective == Transport::mpi || config.collective == Transport::gloo;
  require(!library || config.on_loss == OnLoss::stop, "network.on_loss", "continue",
          "needs network.collective=zeromq: with mpi and gloo a lost worker ends the run, and the launcher starts it again");
  require(!library || config.curve_key_file.empty(), "network.curve_key_file", config.curve_key_file,
          "needs network.collective=zeromq: mpi and gloo have no keys");
  require(config.restarts == 0 || config.on_loss == OnLoss::go_on, "network.restarts", config.restarts,
          "needs network.on_loss=continue: otherwise the run ends with the first lost worker");
  require(!config.insecure || config.curve_key_file.empty(), "network.insecure", true,
          "contradicts network.curve_key_file: set only one of them");
  require(config.allow_list.empty() || !config.curve_key_file.empty(), "network.allow_list", config.allow_list,
          "needs network.curve_key_file: a worker without keys cannot check the keys of others");
  require(config.meeting_key.empty() || !config.curve_key_file.empty(), "network.meeting_key", config.meeting_key,
          "needs network.curve_key_file");
  require(config.meeting_key.empty() || is_curve_key(config.meeting_key), "network.meeting_key", config.meeting_key,
          "must be a public key as `earshot keys` prints it: 40 characters");
}

std::string worker_name(int rank) { return fmt::format("worker {}", rank); }

void validate_world(int num_workers, OnLoss on_loss) {
  require(num_workers >= 1 && num_workers <= kMaxWorkers, "workers", num_workers, fmt::format("must be in [1, {}]", kMaxWorkers));
  require(num_workers <= kMaxMeshWorkers || on_loss == OnLoss::stop, "network.on_loss", "continue",
          fmt::format("must be stop with {} workers: only up to {} workers can continue after a loss", num_workers, kMaxMeshWorkers));
}

}  // namespace earshot
