#include "trainer/net/ring_config.h"

#include <fmt/format.h>

#include <charconv>

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
  reader.read("interface", config.interface);
  reader.read("port_range", config.port_range);
  reader.read("curve_key_file", config.curve_key_file);
  reader.read("allow_list", config.allow_list);
  reader.read("meeting_key", config.meeting_key);
  reader.read("shared_memory", config.shared_memory);
  reader.read("insecure", config.insecure);
  reader.read_choice<OnLoss>("on_loss", config.on_loss, {{"stop", OnLoss::stop}, {"continue", OnLoss::go_on}});
  reader.read("restarts", config.restarts);
  reader.read("progress_timeout_s", config.progress_timeout_s);
}

void validate(const NetworkConfig& config) {
  ports_of(config);
  require(config.progress_timeout_s >= 0.1 && config.progress_timeout_s <= 1e6, "network.progress_timeout_s", config.progress_timeout_s,
          "must be in [0.1, 1e6]: a worker without progress for this time counts as lost");
  require(config.restarts >= 0 && config.restarts <= 1000000, "network.restarts", config.restarts,
          "must be in [0, 1000000]: number of restarts of a lost worker");
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
