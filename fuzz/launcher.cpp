// SPDX-License-Identifier: Apache-2.0
// What a launcher says in environment variables: host lists, and whole sets of variables, one NAME=VALUE per line.
#include "fuzz/fuzz_target.h"
#include "trainer/launch/hostlist.h"
#include "trainer/launch/launcher_environment.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace earshot;
  std::string_view text = fuzz::text_of(data, size);
  const unsigned choice = fuzz::take_choice(text, 2);
  fuzz::expect_value_or_refusal([&] {
    if (choice == 0) {
      constexpr std::size_t kMaxHosts = 1000;
      const auto hosts = expand_hostlist(text, kMaxHosts);
      if (hosts.empty() || hosts.size() > kMaxHosts) fuzz::report("a number of hosts that cannot be", "");
      for (const auto& host : hosts)
        if (host.empty() || host.size() > 253) fuzz::report("a name that cannot be", host);
      return;
    }
    Variables variables;
    while (!text.empty()) {
      const std::string_view line = text.substr(0, text.find('\n'));
      text.remove_prefix(std::min(text.size(), line.size() + 1));
      const std::size_t equals = line.find('=');
      if (equals != std::string_view::npos) variables[std::string(line.substr(0, equals))] = line.substr(equals + 1);
    }
    const auto worker = worker_from(variables);
    // All four variables of our own are checked by the one who listens there.
    if (worker && worker->launcher != "EARSHOT_RANK" &&
        (worker->ring.identity.rank < 0 || worker->ring.identity.rank >= worker->ring.identity.world_size))
      fuzz::report("a rank that cannot be", worker->launcher);
  });
  return 0;
}
