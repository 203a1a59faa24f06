// SPDX-License-Identifier: Apache-2.0
#include "sim/base/process/frame_channel.h"

#include <gtest/gtest.h>
#include <sys/socket.h>

#include <array>
#include <string>
#include <thread>

#include "sim/base/random.h"

namespace earshot {
namespace {

using Status = FrameChannel::Status;

auto in_ms(int ms) { return FrameChannel::Clock::now() + std::chrono::milliseconds(ms); }

TEST(FrameChannel, MessagesOfAnySizeArriveWhole) {
  SocketPair pair = make_socket_pair();
  FrameChannel here(std::move(pair.ours)), there(std::move(pair.theirs));
  std::vector<std::string> sent;
  for (std::uint32_t i = 0; i < 30; ++i) {
    const RandomStream random(5, Purpose::test, i);
    sent.emplace_back(static_cast<std::size_t>(random.uniform(0) * (i % 5 == 0 ? 3e6f : 300.f)), static_cast<char>('a' + i % 26));
  }
  std::jthread sender([&] {
    for (std::size_t i = 0; i < sent.size(); ++i) {
      const std::string_view text = sent[i];
      const std::array parts{text.substr(0, text.size() / 3), text.substr(text.size() / 3)};
      EXPECT_EQ(here.send(i, parts, in_ms(60'000)), Status::done);
    }
  });
  for (std::size_t i = 0; i < sent.size(); ++i) {
    std::uint64_t kind = 0;
    std::string bytes;
    ASSERT_EQ(there.receive(kind, bytes, 3'000'000, in_ms(60'000)), Status::done);
    EXPECT_EQ(kind, i);
    EXPECT_TRUE(bytes == sent[i]);
  }
}

TEST(FrameChannel, SilenceSizeAndEndAreToldApart) {
  SocketPair pair = make_socket_pair();
  const int raw = pair.theirs.get();
  FrameChannel here(std::move(pair.ours));
  std::uint64_t kind = 0;
  std::string bytes;
  EXPECT_EQ(here.receive(kind, bytes, 100, in_ms(50)), Status::timed_out);
  const std::array<std::uint64_t, 2> head{1, std::uint64_t{1} << 60};
  ASSERT_EQ(::send(raw, head.data(), sizeof head, 0), static_cast<ssize_t>(sizeof head));
  EXPECT_EQ(here.receive(kind, bytes, 100, in_ms(5000)), Status::too_large);
  const std::array<std::uint64_t, 2> cut{1, 50};
  ASSERT_EQ(::send(raw, cut.data(), sizeof cut, 0), static_cast<ssize_t>(sizeof cut));
  ASSERT_EQ(::send(raw, cut.data(), 9, 0), 9);
  EXPECT_EQ(here.receive(kind, bytes, 100, in_ms(50)), Status::timed_out);
  const std::string large(std::size_t{8} << 20, 'x');  // more than a socket holds
  const std::array<std::string_view, 1> parts{large};
  EXPECT_EQ(here.send(1, parts, in_ms(50)), Status::timed_out);
  pair.theirs = Descriptor();
  EXPECT_EQ(here.send(1, parts, in_ms(5000)), Status::closed);
  EXPECT_EQ(here.receive(kind, bytes, 100, in_ms(5000)), Status::closed);
}

}  // namespace
}  // namespace earshot
