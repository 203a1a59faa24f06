// SPDX-License-Identifier: Apache-2.0
#include "sim/base/sha256.h"

#include <gtest/gtest.h>

namespace earshot {
namespace {

// Messages and digests of the examples that NIST publishes with FIPS 180-4: one block, two blocks, a million bytes; and the empty message.
TEST(Sha256, GivesThePublishedDigests) {
  EXPECT_EQ(sha256_hex(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256_hex("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256_hex("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  EXPECT_EQ(sha256_hex(std::string(1000000, 'a')), "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

// Lengths about the border where the padding takes a block of its own differ from each other, and in every byte of the message.
TEST(Sha256, EveryByteCounts) {
  for (std::size_t length = 54; length <= 66; ++length) {
    const std::string message(length, 'x');
    EXPECT_NE(sha256_hex(message), sha256_hex(message + 'x'));
    for (std::size_t at = 0; at < length; ++at) {
      std::string other = message;
      other[at] = 'y';
      EXPECT_NE(sha256_hex(message), sha256_hex(other)) << length << ", " << at;
    }
  }
}

}  // namespace
}  // namespace earshot
