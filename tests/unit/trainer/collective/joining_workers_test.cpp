// SPDX-License-Identifier: Apache-2.0
// Workers that come to a run under way, in the place of lost ones: what they and the members see, and what cannot disturb the members.
#include "tests/support/workers/joining_workers.h"

#include <gtest/gtest.h>
#include <signal.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "sim/base/errors.h"
#include "tests/support/workers/curve_ring.h"
#include "trainer/net/curve_keys.h"
#include "trainer/net/join_request.h"
#include "trainer/net/meeting_sockets.h"
#include "trainer/net/rendezvous.h"
#include "trainer/net/wire.h"

namespace earshot {
namespace {

using std::chrono::milliseconds;

// Also the first one, at which the others had met: another one listens there from then on.
TEST_F(JoiningWorkers, AKilledOneComesBack) {
  WorkerProcesses workers(4, member(4));
  wait_for_rounds({0, 1, 2, 3}, 4);
  ::kill(workers.pid(1), SIGKILL);
  wait_for_rounds({0, 2, 3}, 3);
  WorkerProcesses second(1, joiner(1, 4));
  wait_for_rounds({0, 1, 2, 3}, 4);
  ::kill(workers.pid(0), SIGKILL);
  wait_for_rounds({1, 2, 3}, 3);
  WorkerProcesses first(1, joiner(0, 4));
  wait_for_rounds({0, 1, 2, 3}, 4);
  ::kill(second.pid(0), SIGKILL);  // the one that came back, again
  wait_for_rounds({0, 2, 3}, 3);
  WorkerProcesses again(1, joiner(1, 4));
  wait_for_rounds({0, 1, 2, 3}, 4);
  end(workers, {2, 3});
  EXPECT_EQ(first.wait(0), 0);
  EXPECT_EQ(again.wait(0), 0);
  EXPECT_EQ(shared().joined, 3);
}

// It asks before the others have missed the one whose place it takes.
TEST_F(JoiningWorkers, OneThatComesTooEarlyWaits) {
  WorkerProcesses workers(3, member(3, [&](int rank, bool) {
                            if (rank != 0 || shared().hold == 0) return;
                            for (int i = 0; i < 100; ++i) std::this_thread::sleep_for(milliseconds(10));
                            shared().hold = 0;
                          }));
  wait_for_rounds({0, 1, 2}, 3);
  shared().hold = 1;
  ::kill(workers.pid(2), SIGKILL);
  WorkerProcesses back(1, joiner(2, 3));
  wait_for([&] { return shared().joined == 1; });
  wait_for_rounds({0, 1, 2}, 3);
  end(workers, {0, 1});
  EXPECT_EQ(back.wait(0), 0);
}

TEST_F(JoiningWorkers, TwoJoinAtOnceAndOneAloneIsEnoughToJoin) {
  WorkerProcesses workers(4, member(4));
  wait_for_rounds({0, 1, 2, 3}, 4);
  for (const int rank : {1, 2, 3}) {
    ::kill(workers.pid(rank), SIGKILL);
    wait_for_rounds({0}, rank == 1 ? 3 : rank == 2 ? 2 : 1);
  }
  WorkerProcesses back(2, [&](int i) { return joiner(i == 0 ? 1 : 3, 4)(i); });
  wait_for([&] { return shared().joined == 2; });
  wait_for_rounds({0, 1, 3}, 3);
  end(workers, {0});
  back.expect_all_succeed();
}

// The stopped one is left out, its place is taken, and it ends when it wakes: no message of it is taken for one of the new worker.
TEST_F(JoiningWorkers, AStoppedOneThatWakesFindsItsPlaceTaken) {
  SharedArray<std::atomic<int>, 1> left_out;
  WorkerProcesses workers(3, [&](int rank) {
    try {
      return member(3)(rank);
    } catch (const LeftOut& error) {
      std::fprintf(stderr, "worker %d ends: %s\n", rank, error.what());
      left_out[0] = 1;
      return rank == 0;
    }
  });
  wait_for_rounds({0, 1, 2}, 3);
  ::kill(workers.pid(0), SIGSTOP);
  wait_for_rounds({1, 2}, 2);
  WorkerProcesses back(1, joiner(0, 3));
  wait_for_rounds({0, 1, 2}, 3);
  ::kill(workers.pid(0), SIGCONT);
  EXPECT_EQ(workers.wait(0), 0);
  EXPECT_EQ(left_out[0], 1);
  wait_for_rounds({0, 1, 2}, 3);
  // Whatever the old one has removed, the next one finds the meeting point.
  ::kill(workers.pid(2), SIGKILL);
  wait_for_rounds({0, 1}, 2);
  WorkerProcesses another(1, joiner(2, 3));
  wait_for_rounds({0, 1, 2}, 3);
  end(workers, {1});
  EXPECT_EQ(back.wait(0), 0);
  EXPECT_EQ(another.wait(0), 0);
}

/// Asks to join like a worker, is admitted, and then never answers: gone, or there with its listeners and silent.
bool be_admitted_and_silent(const RingConfig& asked, bool stays) {
  RingConfig config = asked;
  config.incarnation = new_incarnation();
  zmq::context_t context(1);
  zmq::socket_t control(context, zmq::socket_type::router), bulk(context, zmq::socket_type::router);
  const std::string control_endpoint = bind_listener(control, config, "control"), bulk_endpoint = bind_listener(bulk, config, "bulk");
  ask_for_admission(context, config, control_endpoint, bulk_endpoint, {});
  if (stays)
    ::pause();
  else
    ::raise(SIGKILL);
  return false;
}

TEST_F(JoiningWorkers, OneThatDiesHalfWayIsDropped) {
  WorkerProcesses workers(3, member(3));
  wait_for_rounds({0, 1, 2}, 3);
  ::kill(workers.pid(1), SIGKILL);
  wait_for_rounds({0, 2}, 2);
  {  // while it asks
    WorkerProcesses asks(1, [&](int) {
      const auto collective = make_joining_worker(ring(1, 3));
      ::raise(SIGKILL);
      return false;
    });
    EXPECT_EQ(WTERMSIG(asks.wait(0)), SIGKILL);
    wait_for_rounds({0, 2}, 2);
  }
  {  // as soon as it may come
    WorkerProcesses admitted(1, [&](int) { return be_admitted_and_silent(ring(1, 3), false); });
    EXPECT_EQ(WTERMSIG(admitted.wait(0)), SIGKILL);
    wait_for_rounds({0, 2}, 2);
  }
  {  // silent from then on
    WorkerProcesses silent(1, [&](int) { return be_admitted_and_silent(ring(1, 3), true); });
    wait_for_rounds({0, 2}, 2);
    std::this_thread::sleep_for(std::chrono::seconds(6));
    wait_for_rounds({0, 2}, 2);
  }
  {  // a member, but without the state of the run
    WorkerProcesses entered(1, [&](int) {
      const auto collective = make_joining_worker(ring(1, 3));
      collective->enter();
      ::raise(SIGKILL);
      return false;
    });
    EXPECT_EQ(WTERMSIG(entered.wait(0)), SIGKILL);
    wait_for_rounds({0, 2}, 2);
  }
  {  // the same with an error of its own: no goodbye ends the run
    WorkerProcesses fails(1, [&](int) -> bool {
      const auto collective = make_joining_worker(ring(1, 3));
      collective->enter();
      throw RunError("test", "fails");
    });
    EXPECT_NE(fails.wait(0), 0);
    wait_for_rounds({0, 2}, 2);
  }
  WorkerProcesses back(1, joiner(1, 3));
  wait_for_rounds({0, 1, 2}, 3);
  end(workers, {0, 2});
  EXPECT_EQ(back.wait(0), 0);
}

TEST_F(JoiningWorkers, OneThatDoesNotFitIsRefused) {
  WorkerProcesses workers(3, member(3));
  wait_for_rounds({0, 1, 2}, 3);
  ::kill(workers.pid(1), SIGKILL);
  wait_for_rounds({0, 2}, 2);
  RingConfig other = ring(1, 3);
  other.engine = "engine-2";
  expect_refused(other, "its engine is engine-2, but the run has engine-1");
  other = ring(1, 3);
  other.settings = "ppo.clip=0.1\nseed=3\n";
  expect_refused(other, "its ppo.clip is 0.1, but the run has 0.2");
  other = ring(1, 3);
  other.settings = "seed=3\n";
  expect_refused(other, "its ppo.clip is (absent), but the run has 0.2");
  other = ring(1, 3);
  other.run_id = "another";
  expect_refused(other, "run id");
  expect_refused(ring(1, 4), "expects 4 workers, but this run started with 3");
  other = ring(1, 3);
  other.network.on_loss = OnLoss::stop;
  expect_refused(other, "network.on_loss");
  // As if the run were new.
  WorkerProcesses starts(1, [&](int) {
    try {
      make_zmq_ring(ring(1, 3));
    } catch (const RunError& error) {
      return std::string(error.what()).find("--join") != std::string::npos;
    }
    return false;
  });
  EXPECT_EQ(starts.wait(0), 0);
  wait_for_rounds({0, 2}, 2);
  end(workers, {0, 2});
}

/// What comes back for a message at the meeting point.
std::string answer_to(const RingConfig& config, const std::string& message) {
  zmq::context_t context(1);
  zmq::socket_t socket = open_meeting_socket(context, zmq::socket_type::dealer, config.rendezvous);
  socket.set(zmq::sockopt::linger, 0);
  socket.connect(config.rendezvous);
  socket.send(zmq::buffer(message), zmq::send_flags::none);
  if (wait_readable(socket, std::chrono::steady_clock::now() + std::chrono::seconds(10)) != Readable::first) return {};
  return receive_parts(socket)[0].to_string();
}

TEST_F(JoiningWorkers, AnotherProtocolVersionAndGarbageAreRefused) {
  WorkerProcesses workers(2, member(2));
  wait_for_rounds({0, 1}, 2);
  WorkerProcesses peer(1, [&](int) {
    JoinRequest request;
    request.version = kWireVersion + 1;
    const auto of_other_version = decode<JoinAnswer>(answer_to(ring(1, 2), encode(request)));
    const auto garbage = decode<JoinAnswer>(answer_to(ring(1, 2), "garbage"));
    std::fprintf(stderr, "%s; %s\n", of_other_version.reason.c_str(), garbage.reason.c_str());
    return of_other_version.state == 0 && of_other_version.reason.find("protocol version") != std::string::npos && garbage.state == 0 &&
           !garbage.reason.empty();
  });
  EXPECT_EQ(peer.wait(0), 0);
  wait_for_rounds({0, 1}, 2);
  end(workers, {0, 1});
}

// A member dies in the very boundary at which another worker is to be let in: the loss comes first, the other one at a later boundary.
TEST_F(JoiningWorkers, OneJoinsWhileAnotherIsLost) {
  for (const int delay_ms : {0, 1, 5, 20}) {
    shared().stop = shared().joined = 0;
    for (auto& view : shared().in_view) view = 0;
    WorkerProcesses workers(5, member(5, [&](int rank, bool joiners) {
                              if (rank != 2 || !joiners) return;
                              if (delay_ms == 0) ::raise(SIGKILL);
                              std::thread([&] {  // in the midst of the admission
                                std::this_thread::sleep_for(milliseconds(delay_ms));
                                ::raise(SIGKILL);
                                ::kill(::getpid(), SIGKILL);
                              })
                                  .detach();
                            }));
    wait_for_rounds({0, 1, 2, 3, 4}, 5);
    ::kill(workers.pid(1), SIGKILL);
    wait_for_rounds({0, 2, 3, 4}, 4);
    WorkerProcesses back(1, joiner(1, 5));
    EXPECT_EQ(WTERMSIG(workers.wait(2)), SIGKILL);
    wait_for([&] { return shared().joined == 1; });
    wait_for_rounds({0, 1, 3, 4}, 4);
    end(workers, {0, 3, 4});
    EXPECT_EQ(back.wait(0), 0);
  }
}

// Once it has the state of the run, an error of its own ends the run as with any other worker.
TEST_F(JoiningWorkers, AnErrorAfterwardsEndsTheRun) {
  WorkerProcesses workers(3, [&](int rank) {
    try {
      member(3)(rank);
    } catch (const RunError& error) {
      return std::string(error.what()).find("worker 1 ") != std::string::npos ||
             std::string(error.what()).find("worker 1:") != std::string::npos;
    }
    return false;
  });
  wait_for_rounds({0, 1, 2}, 3);
  ::kill(workers.pid(1), SIGKILL);
  wait_for_rounds({0, 2}, 2);
  WorkerProcesses back(1, [&](int) -> bool {
    const auto collective = make_joining_worker(ring(1, 3));
    collective->enter();
    collective->confirm_join();
    throw RunError("test", "fails");
  });
  EXPECT_NE(back.wait(0), 0);
  for (const int rank : {0, 2}) EXPECT_EQ(workers.wait(rank), 0) << rank;
}

TEST_F(JoiningWorkers, TheStateGoesToThoseThatHaveJoinedAlone) {
  const std::string state(3'000'001, 's');
  const auto hand_over = [&](Collective& collective, int rank) {
    // Places 0, 1, 2 are ranks 0, 1, 2 again.
    const std::string got = collective.hand_over(2, {1}, rank == 2 ? state : std::string());
    collective.barrier();
    return got == (rank == 1 ? state : std::string());
  };
  WorkerProcesses workers(3, [&](int rank) {
    const auto collective = make_zmq_ring(ring(rank, 3));
    collective->brief("known");
    shared().in_view[rank] = 3;
    if (rank == 1) ::pause();
    while (true) try {
        std::array<double, 1> vote{collective->has_joiners() ? 1.0 : 0.0};
        collective->all_reduce_sum(std::span<double>(vote));
        shared().in_view[rank] = collective->identity().world_size;
        if (vote[0] > 0) collective->admit();
      } catch (const MembershipChange& change) {
        if (change.joined() == std::vector<int>{1}) return hand_over(*collective, rank);
      }
  });
  for (const int rank : {0, 1, 2}) wait_for([&] { return shared().in_view[rank] == 3; });  // all have met
  ::kill(workers.pid(1), SIGKILL);
  wait_for([&] { return shared().in_view[0] == 2 && shared().in_view[2] == 2; });
  WorkerProcesses back(1, [&](int) {
    const auto collective = make_joining_worker(ring(1, 3));
    collective->enter();
    return hand_over(*collective, 1);
  });
  EXPECT_EQ(back.wait(0), 0);
  for (const int rank : {0, 2}) EXPECT_EQ(workers.wait(rank), 0) << rank;
}

// Over tcp with CURVE: a worker with a key of the list joins, one with another does not, and disturbs no member.
TEST_F(JoiningWorkers, TheKeyDecidesWhoMayCome) {
  const auto keys = folder_.path() / "keys", others = folder_.path() / "others";
  write_curve_keys(keys, make_curve_keys());
  const std::string public_key = read_curve_keys(keys).public_key;
  write_curve_keys(others, make_curve_keys());
  const int port = free_port();
  const auto curve = [&](int rank, const std::filesystem::path& file) { return joinable(curve_ring("127.0.0.1", port, rank, 3, file)); };
  WorkerProcesses workers(3, [&](int rank) {
    const auto collective = make_zmq_ring(curve(rank, keys));
    collective->brief("known");
    return Rounds(*collective, rank, shared()).run();
  });
  wait_for_rounds({0, 1, 2}, 3);
  ::kill(workers.pid(0), SIGKILL);  // another one listens at its port from then on
  wait_for_rounds({1, 2}, 2);
  RingConfig unknown_peer = curve(0, others);
  unknown_peer.network.meeting_key = public_key;
  expect_refused(unknown_peer, "does not accept the key");
  wait_for_rounds({1, 2}, 2);
  WorkerProcesses back(1, [&](int) {
    const auto collective = make_joining_worker(curve(0, keys));
    collective->enter();
    collective->confirm_join();
    return Rounds(*collective, 0, shared()).run();
  });
  wait_for_rounds({0, 1, 2}, 3);
  end(workers, {1, 2});
  EXPECT_EQ(back.wait(0), 0);
}

}  // namespace
}  // namespace earshot
