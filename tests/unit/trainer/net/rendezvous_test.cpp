// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/rendezvous.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include <cstring>
#include <thread>

#include "sim/base/errors.h"
#include "tests/support/error_message.h"
#include "tests/support/wait_until.h"
#include "tests/support/workers/worker_processes.h"
#include "trainer/collective/zmq_ring.h"
#include "trainer/net/wire.h"

namespace earshot {
namespace {

using std::chrono::milliseconds;

/// What the worker is told when it says `hello` to the address; empty if nothing within two seconds.
std::string refusal_of(const std::string& address, const std::string& hello) {
  zmq::context_t context;
  zmq::socket_t socket(context, zmq::socket_type::dealer);
  socket.set(zmq::sockopt::linger, 0);
  socket.set(zmq::sockopt::rcvtimeo, 2000);
  socket.connect(address);
  socket.send(zmq::buffer(hello), zmq::send_flags::none);
  zmq::message_t answer;
  return socket.recv(answer) ? decode<Welcome>(answer.to_string_view()).refusal : std::string();
}

/// Bytes that are not even ZMTP, straight into the socket file.
void shout_at(const std::string& socket_file) {
  const int descriptor = ::socket(AF_UNIX, SOCK_STREAM, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, socket_file.c_str(), sizeof(address.sun_path) - 1);
  if (::connect(descriptor, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0) {
    const std::string noise(100000, '\xA5');
    static_cast<void>(::send(descriptor, noise.data(), noise.size(), MSG_NOSIGNAL));
  }
  ::close(descriptor);
}

TEST(Rendezvous, UnknownPeersAreToldWhyAndDisturbNoWorker) {
  const PrivateTestFolder folder;
  const std::string address = ring_in(folder, 0, 3).rendezvous;
  SharedArray<std::atomic<bool>, 1> late_may_come;
  WorkerProcesses workers(3, [&](int rank) {
    if (rank == 2 && !wait_for_flag(late_may_come[0])) return false;
    const auto ring = make_zmq_ring(ring_in(folder, rank, 3));
    std::vector<float> buffer(100000, static_cast<float>(rank));
    ring->all_reduce_sum(buffer);
    return buffer[7] == 3.0f;
  });
  const auto has = [&](const char* name) { return std::filesystem::exists(folder.path() / name); };
  ASSERT_TRUE(workers.wait_until([&] { return has("meet") && has("meet.1.bulk"); }));
  std::this_thread::sleep_for(milliseconds(100));  // worker 1 has said hello

  Hello hello{kWireVersion, "test-run", 2, 3, address + ".2.control", address + ".2.bulk", ""};
  const auto refusal = [&](auto change) {
    Hello changed = hello;
    change(changed);
    return refusal_of(address, encode(changed));
  };
  EXPECT_NE(refusal([](Hello& h) { h.run_id = "another"; }).find("run id"), std::string::npos);
  EXPECT_NE(refusal([](Hello& h) { h.version = kWireVersion + 1; }).find("version " + std::to_string(kWireVersion + 1)), std::string::npos);
  EXPECT_NE(refusal([](Hello& h) { h.rank = 1; }).find("rank 1 is already taken"), std::string::npos);
  EXPECT_NE(refusal([](Hello& h) { h.rank = 0; }).find("rank 0"), std::string::npos);
  EXPECT_NE(refusal([](Hello& h) { h.rank = -1; }).find("rank -1"), std::string::npos);
  EXPECT_NE(refusal([](Hello& h) { h.world_size = 4; }).find("4 workers"), std::string::npos);
  EXPECT_NE(refusal([](Hello& h) { h.bulk_endpoint = "tcp://10.0.0.1:80"; }).find("endpoints"), std::string::npos);
  EXPECT_NE(refusal([](Hello& h) { h.bulk_endpoint = h.control_endpoint + "/../../x"; }).find("endpoints"), std::string::npos);
  EXPECT_NE(refusal_of(address, "garbage").find("control message"), std::string::npos);
  shout_at((folder.path() / "meet").string());

  late_may_come[0] = true;
  workers.expect_all_succeed();
}

TEST(Rendezvous, UnknownPeersOnTheDataPortsAreCountedAndIgnored) {
  const PrivateTestFolder folder;
  SharedArray<std::atomic<bool>, 1> noise_is_over;
  SharedArray<std::uint64_t, 2> unknown_peers;
  WorkerProcesses workers(2, [&](int rank) {
    RingConfig config = ring_in(folder, rank, 2);
    config.network.shared_memory = false;  // sums that share memory look at the ports only where they wait
    ZmqRing ring(config);
    double over = 0;
    while (over < 2) {  // until both have seen the end of the noise
      std::vector<float> buffer(300000, 1.0f);
      ring.all_reduce_sum(buffer);
      for (const float value : buffer)
        if (value != 2.0f) return false;
      over = noise_is_over[0] ? 1 : 0;
      ring.all_reduce_sum(std::span(&over, 1));
    }
    unknown_peers[static_cast<std::size_t>(rank)] = ring.unknown_peers();
    return true;
  });
  const auto has = [&](const char* name) { return std::filesystem::exists(folder.path() / name); };
  ASSERT_TRUE(workers.wait_until([&] { return has("meet.0.bulk") && has("meet.1.bulk"); }));
  std::this_thread::sleep_for(milliseconds(50));
  {
    zmq::context_t context;
    for (const char* name : {"meet.0.control", "meet.0.bulk", "meet.1.control", "meet.1.bulk"}) {
      shout_at((folder.path() / name).string());
      zmq::socket_t socket(context, zmq::socket_type::dealer);
      socket.set(zmq::sockopt::linger, 500);
      socket.connect("ipc://" + (folder.path() / name).string());
      const std::string header(kHeaderBytes, '\x42'), large(kChunkBytes + 100, 'x');
      for (int i = 0; i < 20; ++i) {
        socket.send(zmq::buffer(header), zmq::send_flags::sndmore);
        socket.send(zmq::str_buffer("payload"), zmq::send_flags::none);
        socket.send(zmq::str_buffer(""), zmq::send_flags::none);
      }
      for (int i = 0; i < 9; ++i) socket.send(zmq::str_buffer("part"), i < 8 ? zmq::send_flags::sndmore : zmq::send_flags::none);
      socket.send(zmq::buffer(large), zmq::send_flags::dontwait);  // over the size limit: libzmq hangs up on us
    }
    std::this_thread::sleep_for(milliseconds(200));
  }
  noise_is_over[0] = true;
  workers.expect_all_succeed();
  EXPECT_GE(unknown_peers[0], 40u);
  EXPECT_GE(unknown_peers[1], 40u);
}

TEST(Rendezvous, WrongRunIdIsARunErrorAtTheUnknownPeer) {
  const PrivateTestFolder folder;
  WorkerProcesses workers(2, [&](int rank) {
    RingConfig config = ring_in(folder, rank, 2);
    if (rank == 0) {
      config.timeout = milliseconds(1000);
      return error_message([&] { make_zmq_ring(config); }).find("worker 1 of 2 did not connect within 1000 ms") != std::string::npos;
    }
    config.run_id = "another";
    return error_message([&] { make_zmq_ring(config); }).find("refuses worker 1: its run id") != std::string::npos;
  });
  workers.expect_all_succeed();
}

TEST(Rendezvous, NoRankZeroEndsAfterTheTimeout) {
  const PrivateTestFolder folder;
  RingConfig config = ring_in(folder, 1, 2);
  config.timeout = milliseconds(300);
  EXPECT_NE(error_message([&] { make_zmq_ring(config); }).find("worker 0 did not answer within 300 ms"), std::string::npos);
}

TEST(Rendezvous, OnlyMissingWorkersAreAnIncompleteWorld) {
  const PrivateTestFolder folder;
  WorkerProcesses workers(3, [&](int rank) {  // of a start with 2 and one with 3 workers, and of another run
    RingConfig config = ring_in(folder, rank, rank == 0 ? 2 : 3);
    if (rank == 0) config.timeout = milliseconds(2000);
    if (rank == 2) config.run_id = "another";
    try {
      make_zmq_ring(config);
    } catch (const WorldIncomplete&) {
      return rank != 2;
    } catch (const RunError&) {
      return rank == 2;
    }
    return false;
  });
  workers.expect_all_succeed();
}

TEST(Rendezvous, BadConfigsAreInputErrors) {
  const PrivateTestFolder folder;
  const RingConfig good = ring_in(folder, 0, 2);
  EXPECT_NO_THROW(validate(good));
  const auto expect_refused = [&](auto change, const std::string& text) {
    RingConfig config = good;
    change(config);
    EXPECT_THROW(make_zmq_ring(config), InputError) << text;
    EXPECT_NE(error_message([&] { make_zmq_ring(config); }).find(text), std::string::npos) << error_message([&] { make_zmq_ring(config); });
  };
  expect_refused([](RingConfig& c) { c.rendezvous = "tcp://0.0.0.0:5555"; }, "CURVE");
  expect_refused([](RingConfig& c) { c.rendezvous = "tcp://*:5555"; }, "invalid character");
  expect_refused([](RingConfig& c) { c.rendezvous = "tcp://127.0.0.1.example.com:5555"; }, "CURVE");
  expect_refused([](RingConfig& c) { c.rendezvous = "tcp://127.0.0.1:notaport"; }, "port");
  expect_refused([](RingConfig& c) { c.rendezvous = "tcp://127.0.0.1:*"; }, "port");
  expect_refused([](RingConfig& c) { c.rendezvous = "udp://127.0.0.1:5555"; }, "not an address");
  expect_refused([](RingConfig& c) { c.rendezvous = ""; }, "not an address");
  expect_refused([](RingConfig& c) { c.rendezvous = "ipc://@abstract"; }, "socket file");
  expect_refused([](RingConfig& c) { c.rendezvous = "ipc:///nowhere/at/all/meet"; }, "not a folder");
  expect_refused([](RingConfig& c) { c.rendezvous += std::string(100, 'x'); }, "too long");
  expect_refused([](RingConfig& c) { c.identity = {2, 2}; }, "rank = 2");
  expect_refused([](RingConfig& c) { c.identity = {-1, 2}; }, "rank = -1");
  expect_refused([](RingConfig& c) { c.identity = {0, 0}; }, "world size = 0");
  expect_refused([](RingConfig& c) { c.timeout = milliseconds(0); }, "timeout = 0");
  ::chmod(folder.path().c_str(), 0755);
  expect_refused([](RingConfig&) {}, "accessed by other users");
}

}  // namespace
}  // namespace earshot
