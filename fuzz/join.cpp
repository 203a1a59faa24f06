// SPDX-License-Identifier: Apache-2.0
// Messages of workers that join a run under way, their rules (trainer/net/meeting_sockets.h), and views that others propose.
#include "fuzz/fuzz_target.h"
#include "trainer/net/meeting_sockets.h"

namespace {

using namespace earshot;  // NOLINT(google-build-using-namespace)

RingConfig run() {
  RingConfig config;
  config.identity = {1, 3};
  config.rendezvous = "tcp://127.0.0.1:29000";
  config.run_id = "run";
  config.engine = "engine";
  config.settings = "ppo.clip=0.2\nseed=1\n";
  config.network.on_loss = OnLoss::go_on;
  return config;
}

void expect_possible(const RingConfig& config, const std::string& endpoint) {
  if (!endpoint.starts_with("tcp://127.") && !endpoint.starts_with("tcp://[::1]")) fuzz::report("an endpoint on another host", endpoint);
  if (!is_possible_endpoint(config, endpoint)) fuzz::report("an endpoint that is not possible", endpoint);
}

template <class Message>
void expect_rules(std::string_view bytes, bool has_endpoints) {
  const RingConfig config = run();
  const auto message = decode<Message>(bytes);
  if (encode(decode<Message>(encode(message), bytes.size() + 64)) != encode(message)) fuzz::report("the way back differs", "");
  if (!objection_to(message, config).empty()) return;
  if (message.run_id != config.run_id || message.rank < 0 || message.rank >= 3) fuzz::report("a worker of another run is let in", "");
  if (!has_endpoints && message.control_endpoint.empty()) return;
  expect_possible(config, message.control_endpoint);
  expect_possible(config, message.bulk_endpoint);
}

void expect_admission(std::string_view bytes) {
  const RingConfig config = run();
  const auto answer = decode<JoinAnswer>(bytes);
  check(answer, config, false);
  if ((answer.joining & 2) == 0 || ((answer.members | answer.joining) & ~std::uint64_t{7}) != 0) fuzz::report("a view of other ranks", "");
  // What a worker that joins begins with.
  ViewAgreement views(1, {answer.epoch, answer.members}, answer.joining);
  if (!views.is_open() || !views.proposal().has(1)) fuzz::report("a view without the worker", "");
}

/// Two bytes are a proposal: its sender, epoch and members.
void expect_agreement(std::string_view bytes) {
  ViewAgreement views(1, {4, 0b1111});
  for (std::size_t i = 0; i + 1 < bytes.size(); i += 2) {
    const auto first = static_cast<unsigned char>(bytes[i]), second = static_cast<unsigned char>(bytes[i + 1]);
    const View before = views.proposal(), current = views.current();
    const auto effect = views.receive((first & 3) == 1 ? 0 : first & 3, {3u + (first >> 2 & 3), second & 15u});
    if (effect == ViewAgreement::Effect::excluded) return;
    if (views.proposal().epoch < before.epoch || !views.proposal().has(1)) fuzz::report("a proposal goes back", "");
    if (views.is_open() && (views.proposal().members & ~(before.members | current.members)) != 0)
      fuzz::report("a proposal gains a member", "");
    if (views.is_decided()) views.adopt();
  }
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::string_view bytes = fuzz::text_of(data, size);
  const unsigned choice = fuzz::take_choice(bytes, 5);
  try {
    if (choice == 0) expect_rules<Hello>(bytes, true);
    if (choice == 1) expect_rules<JoinRequest>(bytes, false);
    if (choice == 2) expect_admission(bytes);
    if (choice == 3) check(decode<CandidateList>(bytes), {4, 0b101}, 3);
    if (choice == 4) expect_agreement(bytes);
  } catch (const WireError&) {
  }
  return 0;
}
