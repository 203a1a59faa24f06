// SPDX-License-Identifier: Apache-2.0
#include "trainer/launch/transport.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "sim/base/errors.h"
#include "tests/support/error_message.h"

namespace earshot {
namespace {

using testing::HasSubstr;

NetworkConfig network_of(Transport transport) {
  NetworkConfig network;
  network.collective = transport;
  return network;
}

// Drawn worlds: which transport `auto` takes depends on their size and on the launcher alone.
TEST(ChosenTransport, AutoIsZeroMqUpTo64WorkersThenWhatTheLauncherBrings) {
  std::mt19937 random(1);
  for (int i = 0; i < 200; ++i) {
    const int workers = std::uniform_int_distribution(2, 200)(random);
    const bool pmix = random() % 2 == 0;
    const Transport expected = workers <= 64 ? Transport::zeromq : pmix ? Transport::mpi : Transport::gloo;
    const ChosenTransport chosen = choose_transport({}, workers, pmix, {.mpi = true, .gloo = true});
    EXPECT_EQ(chosen.transport, expected) << workers << pmix;
    EXPECT_THAT(chosen.reason, HasSubstr(std::to_string(workers) + " workers"));
    if (workers <= 64) continue;
    EXPECT_THAT(chosen.reason, HasSubstr(pmix ? "brings PMIx" : "brings no PMIx"));
  }
}

TEST(ChosenTransport, AStatedOneIsTaken) {
  const BuiltTransports all{.mpi = true, .gloo = true};
  for (const Transport transport : {Transport::zeromq, Transport::mpi, Transport::gloo})
    EXPECT_EQ(choose_transport(network_of(transport), 64, true, all).transport, transport);
}

TEST(ChosenTransport, WhatCannotBeIsRefusedInOneLine) {
  const auto refusal = [](NetworkConfig network, int workers, bool pmix, BuiltTransports built) {
    return error_message([&] { choose_transport(network, workers, pmix, built); });
  };
  const BuiltTransports all{.mpi = true, .gloo = true}, none{};
  EXPECT_THAT(refusal(network_of(Transport::mpi), 2, true, none), HasSubstr("install libopenmpi-dev"));
  EXPECT_THAT(refusal(network_of(Transport::mpi), 2, false, all), HasSubstr("mpirun -n N"));
  EXPECT_THAT(refusal(network_of(Transport::gloo), 2, false, none), HasSubstr("install libgloo-dev"));
  EXPECT_THAT(refusal({}, 65, true, {.gloo = true}), HasSubstr("install libopenmpi-dev"));
  EXPECT_THAT(refusal({}, 65, false, {.mpi = true}), HasSubstr("install libgloo-dev"));
  EXPECT_THAT(refusal(network_of(Transport::zeromq), 65, true, all), HasSubstr("connects up to 64 workers, not 65"));
  NetworkConfig keys;
  keys.curve_key_file = "k";
  EXPECT_THAT(refusal(keys, 65, true, all), HasSubstr("has no keys"));
  EXPECT_EQ(choose_transport(keys, 64, true, all).transport, Transport::zeromq);
  for (const Transport transport : {Transport::mpi, Transport::gloo}) {
    NetworkConfig network = network_of(transport);
    network.on_loss = OnLoss::go_on;
    EXPECT_THAT(error_message([&] { validate(network); }), HasSubstr("network.on_loss = continue: needs network.collective=zeromq"));
  }
}

}  // namespace
}  // namespace earshot
