#include "trainer/learner_links.h"

#include <fmt/format.h>

#include "sim/base/errors.h"
#include "trainer/wire.h"

namespace earshot {
namespace {

struct VerdictMessage {
  static constexpr std::size_t kFields = 6;
  std::uint16_t version = kWireVersion;
  bool finite_here = true, finite_average = true;
  std::uint64_t average_hash = 0;
  double loss = 0, approx_kl = 0;
  MSGPACK_DEFINE(version, finite_here, finite_average, average_hash, loss, approx_kl)  // append fields, never reorder
};

StepVerdict decode_verdict(std::size_t rank, const std::string& bytes) {
  try {
    const auto message = decode<VerdictMessage>(bytes);
    return {message.finite_here, message.finite_average, message.average_hash, message.loss, message.approx_kl};
  } catch (const WireError& error) {
    throw RunError(fmt::format("worker {}", rank), fmt::format("breaks the protocol: {}", error.what()));
  }
}

}  // namespace

AverageGradients average_over(Collective& collective) {
  return [&collective, share = 1.0f / static_cast<float>(collective.identity().world_size)](std::span<float> buffer) {
    if (collective.identity().world_size == 1) return;
    collective.all_reduce_sum(buffer);
    for (float& value : buffer) value *= share;
  };
}

SumStatistics sum_over(Collective& collective) {
  return [&collective](std::span<double> sums) { collective.all_reduce_sum(sums); };
}

ExchangeVerdicts exchange_over(Collective& collective) {
  return [&collective](const StepVerdict& mine) {
    if (collective.identity().world_size == 1) return std::vector<StepVerdict>{mine};
    const VerdictMessage message{kWireVersion, mine.finite_here, mine.finite_average, mine.average_hash, mine.loss, mine.approx_kl};
    const auto shares = collective.all_gather(encode(message));
    std::vector<StepVerdict> verdicts;
    for (std::size_t rank = 0; rank < shares.size(); ++rank) verdicts.push_back(decode_verdict(rank, shares[rank]));
    return verdicts;
  };
}

}  // namespace earshot
