// SPDX-License-Identifier: Apache-2.0
#include "trainer/launch/hostlist.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim/base/errors.h"

namespace earshot {
namespace {

using testing::ElementsAre;

TEST(Hostlist, ExpandsAsSlurmDoes) {
  // Right-hand sides: `scontrol show hostnames LIST` of Slurm 22.05.
  EXPECT_THAT(expand_hostlist("login"), ElementsAre("login"));
  EXPECT_THAT(expand_hostlist("n1,n3"), ElementsAre("n1", "n3"));
  EXPECT_THAT(expand_hostlist("n[1-3,7]"), ElementsAre("n1", "n2", "n3", "n7"));
  EXPECT_THAT(expand_hostlist("n[08-11],gpu[3]"), ElementsAre("n08", "n09", "n10", "n11", "gpu3"));
  EXPECT_THAT(expand_hostlist("r[1-2]c[0-1]"), ElementsAre("r1c0", "r1c1", "r2c0", "r2c1"));
  // Slurm takes no suffix after a bracket; the notation is common elsewhere.
  EXPECT_THAT(expand_hostlist("node[2,1]-ib0.cluster_a"), ElementsAre("node2-ib0.cluster_a", "node1-ib0.cluster_a"));
  EXPECT_EQ(expand_hostlist("n[0-65535]").size(), 65536u);
}

TEST(Hostlist, RefusesWhatIsNoListInOneLine) {
  for (const char* text : {"",
                           ",",
                           "a,",
                           ",a",
                           "a,,b",
                           "a[",
                           "a[]",
                           "a[1",
                           "a[1-",
                           "a[1-]",
                           "a[-2]",
                           "a[1,]",
                           "a[,1]",
                           "a]",
                           "a[3-1]",
                           "a[1]]",
                           "a[[1]]",
                           "a[x]",
                           "a b",
                           "a\nb",
                           "a[1 ]",
                           "[1-2],[",
                           "a[1234567890]",
                           "a[0-65536]",
                           "a[0-999]b[0-999]",
                           "a[0-999999999]"}) {
    try {
      expand_hostlist(text);
      ADD_FAILURE() << "'" << text << "' was taken";
    } catch (const InputError& error) {
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << text;
    }
  }
  EXPECT_THROW(expand_hostlist(std::string(254, 'a')), InputError);
  EXPECT_THROW(expand_hostlist(std::string(1 << 20, 'a')), InputError);
  EXPECT_NO_THROW(expand_hostlist(std::string(253, 'a')));
  EXPECT_THROW(expand_hostlist("n[1-3]", 2), InputError);
}

}  // namespace
}  // namespace earshot
