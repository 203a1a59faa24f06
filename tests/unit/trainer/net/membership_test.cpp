// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/membership.h"

#include <gtest/gtest.h>

#include <bit>
#include <deque>
#include <map>
#include <optional>
#include <vector>

#include "sim/base/random.h"

namespace earshot {
namespace {

using Effect = ViewAgreement::Effect;

View all_of(int count) { return {0, (std::uint64_t{1} << count) - 1}; }

TEST(ViewAgreement, LeavesOutWhoIsLostOnceAllSaySo) {
  ViewAgreement a(0, all_of(3)), b(1, all_of(3));
  EXPECT_FALSE(a.is_open());
  a.leave_out(2);
  EXPECT_TRUE(a.is_open());
  EXPECT_FALSE(a.is_decided());
  EXPECT_EQ(b.receive(0, a.proposal()), Effect::proposal_changed);
  EXPECT_TRUE(b.is_decided());
  EXPECT_EQ(a.receive(1, b.proposal()), Effect::none);
  ASSERT_TRUE(a.is_decided());
  a.adopt();
  b.adopt();
  EXPECT_EQ(a.current(), (View{1, 0b011}));
  EXPECT_EQ(a.current(), b.current());
  EXPECT_EQ(a.current().ranks(), (std::vector<int>{0, 1}));
  EXPECT_EQ(a.receive(1, View{1, 0b011}), Effect::none);  // late
  EXPECT_FALSE(a.is_open());
}

TEST(ViewAgreement, AWorkerThatIsLeftOutIsTold) {
  ViewAgreement c(2, all_of(3));
  EXPECT_EQ(c.receive(0, View{1, 0b011}), Effect::excluded);
}

TEST(ViewAgreement, RenewsConnectionsOfTheSameWorkers) {
  ViewAgreement a(0, all_of(2)), b(1, all_of(2));
  a.renew();
  EXPECT_EQ(b.receive(0, a.proposal()), Effect::proposal_changed);
  EXPECT_EQ(b.proposal(), (View{1, 0b11}));
  a.receive(1, b.proposal());
  EXPECT_TRUE(a.is_decided() && b.is_decided());
}

TEST(ViewAgreement, OnlyAMajorityOrTheHalfWithTheLowestRankGoesOn) {
  const auto goes_on = [](int world_size, int rank, const std::vector<int>& lost) {
    ViewAgreement views(rank, all_of(world_size));
    for (const int other : lost) views.leave_out(other);
    return views.has_quorum();
  };
  EXPECT_TRUE(goes_on(3, 1, {0}));
  EXPECT_FALSE(goes_on(3, 1, {0, 2}));
  EXPECT_TRUE(goes_on(4, 0, {2, 3}));
  EXPECT_FALSE(goes_on(4, 2, {0, 1}));
  EXPECT_TRUE(goes_on(2, 0, {1}));
  EXPECT_FALSE(goes_on(2, 1, {0}));
}

TEST(ViewAgreement, AProposalForADecidedViewOpensALaterOne) {
  ViewAgreement a(0, all_of(4)), b(1, all_of(4));
  a.leave_out(3);
  b.leave_out(3);
  a.receive(1, b.proposal());
  a.receive(2, View{1, 0b0111});
  ASSERT_TRUE(a.is_decided());
  a.adopt();
  // Worker 1 lost 2 before it saw that all had proposed the same.
  b.leave_out(2);
  EXPECT_EQ(a.receive(1, b.proposal()), Effect::proposal_changed);
  EXPECT_EQ(a.proposal(), (View{2, 0b0011}));
  b.receive(0, a.proposal());
  EXPECT_TRUE(a.is_decided() && b.is_decided());
}

// Who has left out a worker in the midst of an agreement takes a later epoch: the one that was left out may have decided the first view.
TEST(ViewAgreement, NoEpochHasTwoViews) {
  ViewAgreement a(0, all_of(5)), b(1, all_of(5)), c(2, all_of(5)), d(3, all_of(5));
  for (ViewAgreement* worker : {&a, &b, &c, &d}) worker->leave_out(4);
  for (const int other : {1, 2, 3}) a.receive(other, b.proposal());
  ASSERT_TRUE(a.is_decided());
  a.adopt();
  for (ViewAgreement* worker : {&b, &c, &d}) worker->leave_out(0);
  for (const int other : {2, 3}) b.receive(other, c.proposal());
  ASSERT_TRUE(b.is_decided());
  b.adopt();
  EXPECT_EQ(a.current(), (View{1, 0b01111}));
  EXPECT_EQ(b.current(), (View{2, 0b01110}));
}

// Workers that propose different views for one epoch meet in a later one.
TEST(ViewAgreement, DifferentProposalsMeetInALaterEpoch) {
  ViewAgreement a(0, all_of(5)), b(1, all_of(5)), c(2, all_of(5));
  a.leave_out(3);
  b.leave_out(4);
  c.renew();
  for (int round = 0; round < 3; ++round) {
    const View of_a = a.proposal(), of_b = b.proposal(), of_c = c.proposal();
    a.receive(1, of_b), a.receive(2, of_c);
    b.receive(0, of_a), b.receive(2, of_c);
    c.receive(0, of_a), c.receive(1, of_b);
  }
  ASSERT_TRUE(a.is_decided() && b.is_decided() && c.is_decided());
  EXPECT_EQ(a.proposal().members, 0b00111u);
  EXPECT_GT(a.proposal().epoch, 1u);
  EXPECT_EQ(a.proposal(), b.proposal());
  EXPECT_EQ(a.proposal(), c.proposal());
}

TEST(ViewAgreement, AWorkerJoinsOnceAllHaveProposedIt) {
  const View left{3, 0b011};
  ViewAgreement a(0, left), b(1, left), c(2, left, 0b100);
  EXPECT_TRUE(c.is_open());
  EXPECT_FALSE(a.knows(2));
  EXPECT_EQ(a.receive(2, c.proposal()), Effect::none);  // has not heard of it
  a.invite(0b100);
  b.invite(0b100);
  EXPECT_TRUE(a.knows(2));
  EXPECT_FALSE(a.is_open());
  a.renew();
  EXPECT_EQ(a.proposal(), (View{4, 0b111}));
  EXPECT_EQ(b.receive(0, a.proposal()), Effect::proposal_changed);
  a.receive(1, b.proposal());
  EXPECT_FALSE(a.is_decided());  // not before the new one has said so
  for (ViewAgreement* member : {&a, &b}) member->receive(2, c.proposal());
  c.receive(0, a.proposal());
  EXPECT_FALSE(c.is_decided());
  c.receive(1, b.proposal());
  for (ViewAgreement* all : {&a, &b, &c}) {
    ASSERT_TRUE(all->is_decided());
    all->adopt();
    EXPECT_EQ(all->current(), (View{4, 0b111}));
  }
}

TEST(ViewAgreement, ALossThatOthersHaveNotHeardOfComesBeforeAJoin) {
  const View left{3, 0b01011};
  ViewAgreement a(0, left), b(1, left), c(2, left, 0b100);
  a.invite(0b100);
  a.renew();
  b.leave_out(3);  // had not been told of the new one
  EXPECT_EQ(b.receive(0, a.proposal()), Effect::none);
  EXPECT_EQ(a.receive(1, b.proposal()), Effect::proposal_changed);
  EXPECT_EQ(a.proposal(), (View{5, 0b00011}));  // 4 is the epoch of its view with the new one
  EXPECT_EQ(c.receive(0, a.proposal()), Effect::excluded);
  b.receive(0, a.proposal());
  a.receive(1, b.proposal());
  EXPECT_TRUE(a.is_decided() && b.is_decided());
}

// Joining workers do not count for the majority: two parts of a network that is cut never both go on with their help.
TEST(ViewAgreement, TheMajorityIsOfMembers) {
  const View left{3, 0b00111};
  ViewAgreement a(2, left), c(3, left, 0b11000);
  a.invite(0b11000);
  a.renew();
  for (ViewAgreement* part : {&a, &c}) {
    part->leave_out(0);
    part->leave_out(1);
    EXPECT_FALSE(part->has_quorum());
  }
}

/// Workers with channels in order that lose what a worker had not yet been handed when it died; who is dead is noticed by each at its own
/// time, in the midst of agreements.
class Simulation {
 public:
  Simulation(int count, std::uint32_t trial) : count_(count), trial_(trial) {
    for (int rank = 0; rank < count; ++rank) {
      workers_.emplace_back(rank, all_of(count));
      sent_.emplace_back(View{});
    }
  }
  /// From the midst of a run: workers of the mask are away, and come to those that are left, once these have all been told of them.
  Simulation(int count, std::uint32_t trial, std::uint64_t joining) : count_(count), trial_(trial) {
    const View left{5, all_of(count).members & ~joining};
    for (int rank = 0; rank < count; ++rank) {
      if (left.has(rank)) {
        workers_.emplace_back(rank, left).invite(joining);
        if (draw(2) == 0) workers_.back().renew();
      } else {
        workers_.emplace_back(rank, left, joining);
      }
      sent_.emplace_back(View{});
    }
    joins_ = joining;
  }
  [[nodiscard]] std::uint64_t excluded() const { return excluded_; }
  /// Kills `deaths` workers at random moments; returns the views that the living have in the end.
  std::vector<View> run(int deaths) {
    int idle = 0;
    for (int step = 0; idle < 500 || deaths > 0; ++step) {
      if (step > 100000) ADD_FAILURE() << "no end";
      if (step > 100000) break;
      if (deaths > 0 && draw(40) == 0) {
        dead_ |= std::uint64_t{1} << draw(static_cast<std::uint32_t>(count_));
        --deaths;
      }
      const int rank = static_cast<int>(draw(static_cast<std::uint32_t>(count_)));
      idle = dead(rank) || !act(rank) ? idle + 1 : 0;
    }
    std::vector<View> views;
    for (int rank = 0; rank < count_; ++rank)
      if (!dead(rank)) views.push_back(workers_[static_cast<std::size_t>(rank)].current());
    return views;
  }
  [[nodiscard]] std::uint64_t living() const { return all_of(count_).members & ~dead_; }

 private:
  std::uint32_t draw(std::uint32_t bound) { return RandomStream(trial_, Purpose::test, 11).below(bound, draws_++); }
  [[nodiscard]] bool dead(int rank) const { return (dead_ >> rank & 1) != 0; }
  /// One thing that this worker can do; false if there was nothing.
  bool act(int rank) {
    ViewAgreement& views = workers_[static_cast<std::size_t>(rank)];
    const int other = static_cast<int>(draw(static_cast<std::uint32_t>(count_)));
    if (other == rank) return false;
    if (auto& channel = channels_[{other, rank}]; !channel.empty()) {
      const bool before = views.is_open();
      if (views.receive(other, channel.front()) == Effect::excluded) {
        EXPECT_TRUE((joins_ >> rank & 1) != 0) << "worker " << rank << " lives";
        excluded_ |= std::uint64_t{1} << rank;
        dead_ |= std::uint64_t{1} << rank;
      } else if (joins_ != 0 && (joins_ >> rank & 1) != 0 && before) {
        sent_[static_cast<std::size_t>(rank)] = {};  // one that joins answers each proposal
      }
      channel.pop_front();
    } else if (dead(other) && views.proposal().has(other)) {
      if (draw(3) != 0) return true;
      views.leave_out(other);
    } else if (views.is_open() && sent_[static_cast<std::size_t>(rank)] != views.proposal()) {
      for (int to = 0; to < count_; ++to)
        if (to != rank && views.knows(to)) channels_[{rank, to}].push_back(views.proposal());
      sent_[static_cast<std::size_t>(rank)] = views.proposal();
    } else if (views.is_decided() && sent_[static_cast<std::size_t>(rank)] == views.proposal()) {
      views.adopt();
    } else {
      return false;
    }
    return true;
  }

  int count_;
  std::uint32_t trial_, draws_ = 0;
  std::uint64_t dead_ = 0, joins_ = 0, excluded_ = 0;
  std::vector<ViewAgreement> workers_;
  std::vector<View> sent_;
  std::map<std::pair<int, int>, std::deque<View>> channels_;
};

TEST(ViewAgreement, LivingWorkersEndWithTheSameView) {
  int with_losses = 0;
  for (std::uint32_t trial = 0; trial < 400; ++trial) {
    const int count = 3 + static_cast<int>(trial % 6), deaths = static_cast<int>(trial % 3) % ((count + 1) / 2);
    Simulation simulation(count, trial);
    const auto views = simulation.run(deaths);
    for (const View& view : views) {
      EXPECT_EQ(view, views.front()) << trial;
      EXPECT_EQ(view.members, simulation.living()) << trial;
    }
    with_losses += std::popcount(simulation.living()) < count;
  }
  EXPECT_GT(with_losses, 150);
}

// The same where workers join: who lives and was not turned away is in the view of all, and no member is ever turned away.
TEST(ViewAgreement, LivingWorkersEndWithTheSameViewWhereOthersJoin) {
  int with_joins = 0, with_losses = 0;
  for (std::uint32_t trial = 0; trial < 600; ++trial) {
    const int count = 4 + static_cast<int>(trial % 5);
    const std::uint64_t joining = trial % 2 == 0 ? 0b0100 : 0b1001;
    const int members = count - std::popcount(joining);
    const int deaths = static_cast<int>(trial % 3) % ((members + 1) / 2);
    Simulation simulation(count, trial, joining);
    const auto views = simulation.run(deaths);
    ASSERT_FALSE(views.empty());
    for (const View& view : views) {
      EXPECT_EQ(view, views.front()) << trial;
      EXPECT_EQ(view.members, simulation.living()) << trial;
    }
    with_joins += (views.front().members & joining) != 0;
    with_losses += simulation.excluded() != 0 || std::popcount(simulation.living()) < count;
  }
  EXPECT_GT(with_joins, 200);
  EXPECT_GT(with_losses, 200);
}

}  // namespace
}  // namespace earshot
