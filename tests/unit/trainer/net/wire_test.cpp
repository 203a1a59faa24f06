// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/wire.h"

#include <gtest/gtest.h>

#include "sim/base/random.h"

namespace earshot {
namespace {

const Hello kHello{kWireVersion, "run", 3, 8, "ipc:///tmp/x/meet.3.control", "ipc:///tmp/x/meet.3.bulk", "a-public-key"};

/// The bytes with one byte replaced; which and by what is a function of `trial`.
std::string damaged(std::string bytes, std::uint32_t trial) {
  const RandomStream random(7, Purpose::action, trial);
  bytes[random.below(static_cast<std::uint32_t>(bytes.size()), 0)] ^= static_cast<char>(1 + random.below(255, 1));
  return bytes;
}

TEST(Wire, ControlMessageComesBackWhole) {
  const Hello back = decode<Hello>(encode(kHello));
  EXPECT_EQ(back.run_id, kHello.run_id);
  EXPECT_EQ(back.rank, 3);
  EXPECT_EQ(back.world_size, 8);
  EXPECT_EQ(back.bulk_endpoint, kHello.bulk_endpoint);
  EXPECT_EQ(back.public_key, kHello.public_key);
}

TEST(Wire, EveryTruncationAndAnyTrailerIsRefused) {
  const std::string bytes = encode(kHello);
  for (std::size_t length = 0; length < bytes.size(); ++length) EXPECT_THROW(decode<Hello>(bytes.substr(0, length)), WireError) << length;
  EXPECT_THROW(decode<Hello>(bytes + "x"), WireError);
}

TEST(Wire, DamagedControlMessagesAreRefusedOrStillMessages) {
  const std::string bytes = encode(kHello);
  int refused = 0;
  for (std::uint32_t trial = 0; trial < 5000; ++trial) {
    try {
      decode<Hello>(damaged(bytes, trial));
    } catch (const WireError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 100);  // flips within a text stay valid texts; flips of types, lengths and the version do not
}

TEST(Wire, ForgedLengthsDoNotAllocate) {
  const std::string huge_list("\xdd\xff\xff\xff\xff", 5), huge_text("\x96\x01\xdb\xff\xff\xff\xff", 7);
  EXPECT_THROW(decode<Hello>(huge_list), WireError);
  EXPECT_THROW(decode<Hello>(huge_text), WireError);
  EXPECT_THROW(decode<Hello>(std::string(1000, '\x91')), WireError);  // nested deeper than any message
  EXPECT_THROW(decode<Hello>(std::string(kMaxControlBytes + 1, '\x01')), WireError);
}

TEST(Wire, OtherVersionIsNamed) {
  Hello hello = kHello;
  hello.version = 9;
  try {
    decode<Hello>(encode(hello));
    FAIL();
  } catch (const WireError& error) {
    EXPECT_NE(std::string(error.what()).find("version 9"), std::string::npos);
  }
}

TEST(Wire, HeaderComesBackWhole) {
  const FrameHeader header{Operation::all_gather, 1, 0x0123456789ABCDEF, 42, 3, 2, 4096, 100, 5000};
  EXPECT_EQ(decode_header(encode_header(header)), header);
}

TEST(Wire, ImpossibleHeadersAreRefused) {
  const FrameHeader good{Operation::all_gather, 1, 1, 42, 3, 2, 4096, 100, 5000};
  const auto refused = [](const FrameHeader& header) {
    try {
      decode_header(encode_header(header));
      return false;
    } catch (const WireError&) {
      return true;
    }
  };
  EXPECT_FALSE(refused(good));
  FrameHeader bad = good;
  bad.length = kChunkBytes + 1, bad.total = 1u << 30;
  EXPECT_TRUE(refused(bad));
  bad = good, bad.offset = 4901;  // offset + length = 5001 > total
  EXPECT_TRUE(refused(bad));
  bad = good, bad.offset = ~std::uint64_t{0};
  EXPECT_TRUE(refused(bad));
  bad = good, bad.operation = static_cast<Operation>(200);
  EXPECT_TRUE(refused(bad));
  auto bytes = encode_header(good);
  EXPECT_THROW(decode_header(std::span(bytes).first(63)), WireError);
  bytes[0] ^= std::byte{1};  // magic
  EXPECT_THROW(decode_header(bytes), WireError);
  bytes[0] ^= std::byte{1}, bytes[4] ^= std::byte{8};  // version
  EXPECT_THROW(decode_header(bytes), WireError);
}

}  // namespace
}  // namespace earshot
