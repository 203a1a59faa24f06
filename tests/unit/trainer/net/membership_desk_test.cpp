// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/membership_desk.h"

#include <gtest/gtest.h>

namespace earshot {
namespace {

class AddressBookTest : public testing::Test {
 protected:
  AddressBookTest() {
    PeerTable table;
    table.run_key = 5;
    for (int rank = 0; rank < 3; ++rank) {
      table.control_endpoints.push_back("control" + std::to_string(rank));
      table.bulk_endpoints.push_back("bulk" + std::to_string(rank));
      table.public_keys.push_back("key" + std::to_string(rank));
    }
    book_.set(table);
  }
  static Candidate candidate(int rank, std::uint32_t incarnation) {
    Candidate candidate;
    candidate.rank = rank;
    candidate.incarnation = incarnation;
    candidate.control_endpoint = "control" + std::to_string(rank) + "." + std::to_string(incarnation);
    candidate.bulk_endpoint = "bulk" + std::to_string(rank) + "." + std::to_string(incarnation);
    candidate.public_key = "key" + std::to_string(rank) + "." + std::to_string(incarnation);
    return candidate;
  }
  AddressBook book_{WorkerIdentity{0, 3}};
};

TEST_F(AddressBookTest, AnotherStartOfARankReplacesItsAddresses) {
  EXPECT_TRUE(book_.is_current({2, 0}));
  book_.replace(candidate(2, 9), true);
  EXPECT_FALSE(book_.is_current({2, 0}));
  EXPECT_TRUE(book_.is_current({2, 9}));
  EXPECT_EQ(book_.control(2).endpoint, "control2.9");
  EXPECT_EQ(book_.bulk(2).endpoint, "bulk2.9");
  EXPECT_EQ(book_.control(2).public_key, "key2.9");
  EXPECT_EQ(book_.control(1).endpoint, "control1");
}

TEST_F(AddressBookTest, AStartThatWasLeftOutIsToldWhereItListens) {
  const auto current = book_.take_notice_address({1, 0});
  ASSERT_TRUE(current);
  EXPECT_EQ(current->endpoint, "control1");
}

// A former member is told that it is not a member; a worker that never was one has no address.
TEST_F(AddressBookTest, NoticesGoToTheStartThatWasAMember) {
  book_.replace(candidate(2, 9), true);
  const auto former = book_.take_notice_address({2, 0});
  ASSERT_TRUE(former);
  EXPECT_EQ(former->endpoint, "control2");
  EXPECT_FALSE(book_.take_notice_address({2, 0})) << "twice within a second";

  book_.replace(candidate(2, 10), false);  // 9 has not taken part
  const auto still_former = book_.take_notice_address({2, 9});
  ASSERT_TRUE(still_former);
  EXPECT_EQ(still_former->endpoint, "control2");
  book_.replace(candidate(1, 4), false);
  EXPECT_FALSE(book_.take_notice_address({1, 0}));
}

TEST_F(AddressBookTest, ListingGivesAnotherBookTheSameAddresses) {
  book_.replace(candidate(2, 9), true);
  AddressBook other(WorkerIdentity{1, 3});
  other.set(book_.listing(77));
  EXPECT_EQ(other.run_key(), 5u);
  EXPECT_TRUE(other.is_current({0, 77}));
  EXPECT_TRUE(other.is_current({2, 9}));
  for (int rank = 0; rank < 3; ++rank) {
    EXPECT_EQ(other.control(rank).endpoint, book_.control(rank).endpoint);
    EXPECT_EQ(other.bulk(rank).public_key, book_.bulk(rank).public_key);
  }
}

}  // namespace
}  // namespace earshot
