// SPDX-License-Identifier: Apache-2.0
#include "trainer/launch/worker_group.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <map>
#include <thread>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/process/exit_codes.h"
#include "tests/support/seconds_since.h"
#include "tests/support/wait_until.h"
#include "tests/support/workers/worker_processes.h"

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

/// The group starts this test program again; EARSHOT_TEST_ROLE tells the copy what to do.
int spawn(int num_workers, const std::string& role, milliseconds grace = milliseconds(5000), OnLoss on_loss = OnLoss::stop,
          int restarts = 0) {
  ::setenv("EARSHOT_TEST_ROLE", role.c_str(), 1);
  ::alarm(60);
  return spawn_workers(num_workers, {"--gtest_filter=WorkerGroupCopy.Acts", "--gtest_brief=1"}, grace, on_loss, restarts);
}

int rank_of_copy() { return std::atoi(std::getenv("EARSHOT_RANK")); }

std::filesystem::path notes() { return std::getenv("EARSHOT_TEST_NOTES"); }
void note(const std::string& name, const std::string& text) { write_file_atomically(notes() / name, text); }

volatile sig_atomic_t caught = 0;

/// What the copies do.  Skipped where no group spawned this process.
TEST(WorkerGroupCopy, Acts) {
  const char* role_text = std::getenv("EARSHOT_TEST_ROLE");
  if (role_text == nullptr || std::getenv("EARSHOT_RANK") == nullptr) GTEST_SKIP() << "acts only as a worker of the other tests";
  const std::string role = role_text;
  const int rank = rank_of_copy();
  ::alarm(60);
  if (role == "sum") {
    const auto config = worker_from_environment();
    if (!config) std::_Exit(10);
    const auto ring = make_zmq_ring(config->ring);
    std::vector<double> buffer{static_cast<double>(1 << rank)};
    ring->all_reduce_sum(std::span<double>(buffer));
    const bool alone = std::string(std::getenv("OMP_NUM_THREADS")) == "3" && std::string(std::getenv("OPENBLAS_NUM_THREADS")) == "1";
    note("rendezvous", config->ring.rendezvous);
    std::_Exit(buffer[0] == 7.0 && alone ? 0 : 11);
  }
  if (role == "fail") {  // rank 1 fails, the others would stay
    note("pid" + std::to_string(rank), std::to_string(::getpid()));
    if (rank != 1) ::pause();
    const auto has = [](const char* name) { return std::filesystem::exists(notes() / name); };
    std::_Exit(wait_until([&] { return has("pid0") && has("pid2"); }, 60) ? 5 : 15);
  }
  if (role == "killed") {
    if (rank == 1) ::raise(SIGKILL);
    ::pause();
  }
  if (role == "lossy") {  // one is killed, one left out, one stands still for ever, one makes it to the end
    if (rank == 0) ::raise(SIGKILL);
    if (rank == 1) std::_Exit(kExitLostWorld);
    if (rank == 2) ::raise(SIGSTOP);
    std::this_thread::sleep_for(milliseconds(300));
    note("end" + std::to_string(rank), "");
    std::_Exit(0);
  }
  if (role == "restarted") {  // rank 1 is killed twice, and then fails by itself; rank 0 waits for that
    std::ifstream file("/proc/self/cmdline");
    const std::string line{std::istreambuf_iterator<char>(file), {}};
    const bool joins = line.find("--join") != std::string::npos;
    if (rank == 0) {
      const bool has_third = wait_until([] { return std::filesystem::exists(notes() / "third"); }, 20);
      std::this_thread::sleep_for(milliseconds(300));
      std::_Exit(!joins && has_third ? 0 : 12);
    }
    const bool first = !std::filesystem::exists(notes() / "first"), second = !first && !std::filesystem::exists(notes() / "second");
    if (joins == first) std::_Exit(13);
    note(first ? "first" : second ? "second" : "third", "");
    if (first || second) ::raise(SIGKILL);
    std::_Exit(5);
  }
  if (role == "stubborn") {  // does not listen to SIGTERM
    ::signal(SIGTERM, SIG_IGN);
    note("pid" + std::to_string(rank), std::to_string(::getpid()));
    if (rank == 0) {
      std::_Exit(wait_until([] { return std::filesystem::exists(notes() / "pid1"); }, 60) ? 4 : 15);
    }
    while (true) ::pause();
  }
  if (role == "polite") {  // ends in order when asked to
    ::signal(SIGTERM, [](int) { caught = 1; });
    note("pid" + std::to_string(rank), std::to_string(::getpid()));
    if (!wait_until([] { return caught != 0; }, 60)) std::_Exit(15);
    note("polite" + std::to_string(rank), "");
    std::_Exit(0);
  }
  if (role == "interrupted") std::_Exit(rank == 0 ? kExitAskedToEnd : kExitDone);
  if (role == "failing") {  // rank 0 loses rank 1, which has a reason of its own to end, and says so later
    if (rank == 0) std::_Exit(wait_until([] { return std::filesystem::exists(notes() / "pid1"); }) ? kExitLostWorld : 15);
    ::signal(SIGTERM, SIG_IGN);
    note("pid1", std::to_string(::getpid()));
    std::this_thread::sleep_for(milliseconds(400));
    std::_Exit(kExitFailed);
  }
  if (role == "crashing") std::abort();
  if (role == "handed") {
    const char* text = std::getenv("EARSHOT_TEST_HANDED");
    std::_Exit(text != nullptr && ::fcntl(std::atoi(text), F_GETFD) >= 0 ? 0 : 14);
  }
  if (role == "wait") {
    note("pid" + std::to_string(rank), std::to_string(::getpid()));
    while (true) ::pause();
  }
}

class WorkerGroup : public testing::Test {
 protected:
  WorkerGroup() {
    ::setenv("EARSHOT_TEST_NOTES", folder_.path().c_str(), 1);
    ::setenv("TMPDIR", folder_.path().c_str(), 1);  // what a killed parent leaves there goes with the test
  }
  [[nodiscard]] bool exists(const std::string& name) const { return std::filesystem::exists(folder_.path() / name); }
  [[nodiscard]] std::string read(const std::string& name) const { return read_file(folder_.path() / name); }
  [[nodiscard]] pid_t pid(int rank) const { return std::stoi(read("pid" + std::to_string(rank))); }
  void wait_for(const std::string& name) const {
    EXPECT_TRUE(wait_until([&] { return exists(name); }, 60)) << name;
  }
  static bool is_running(pid_t pid) {  // a zombie is not
    std::ifstream file("/proc/" + std::to_string(pid) + "/stat");
    std::string line;
    if (!std::getline(file, line)) return false;
    const char state = line.at(line.rfind(')') + 2);
    return state != 'Z' && state != 'X';
  }
  static bool is_gone_soon(pid_t pid) {
    for (int i = 0; i < 400 && is_running(pid); ++i) std::this_thread::sleep_for(milliseconds(5));
    return !is_running(pid);
  }

  PrivateTestFolder folder_;
};

TEST_F(WorkerGroup, WorkersMeetAndLeaveNothingBehind) {
  ::setenv("OMP_NUM_THREADS", "3", 1);  // the caller's choice stands; OpenBLAS's is made for it
  ::unsetenv("OPENBLAS_NUM_THREADS");
  EXPECT_EQ(spawn(3, "sum"), 0);
  const std::string rendezvous = read("rendezvous");
  ASSERT_TRUE(rendezvous.starts_with("ipc:///")) << rendezvous;
  EXPECT_FALSE(std::filesystem::exists(std::filesystem::path(rendezvous.substr(6)).parent_path()));
}

TEST_F(WorkerGroup, FirstFailureStopsTheOthersAndGivesItsCode) {
  const auto start = Clock::now();
  EXPECT_EQ(spawn(3, "fail", std::chrono::seconds(40)), 5);
  EXPECT_LT(seconds_since(start), 30.0);  // SIGTERM sufficed; most of it is the start of three programs
  EXPECT_FALSE(is_running(pid(0)));
  EXPECT_FALSE(is_running(pid(2)));
}

TEST_F(WorkerGroup, KilledWorkerCountsAsFailure) { EXPECT_EQ(spawn(2, "killed"), kExitLostWorld); }

TEST_F(WorkerGroup, CodesAreThoseOfTheTable) {
  EXPECT_EQ(spawn(3, "interrupted"), kExitAskedToEnd);
  EXPECT_EQ(spawn(2, "failing"), kExitFailed) << "a loss that another worker is the reason of";
  EXPECT_EQ(spawn(2, "crashing"), kExitFailed);
}

TEST_F(WorkerGroup, WorkersGetWhatIsHandedToThem) {
  const int descriptor = ::open("/dev/null", O_RDONLY | O_CLOEXEC);
  ::setenv("EARSHOT_TEST_ROLE", "handed", 1);
  ::setenv("EARSHOT_TEST_HANDED", "99", 1);
  ::alarm(60);
  const std::vector<std::string> copy{"--gtest_filter=WorkerGroupCopy.Acts", "--gtest_brief=1"};
  const Handed handed{.descriptors = {descriptor}, .variables = {"EARSHOT_TEST_HANDED=" + std::to_string(descriptor)}};
  EXPECT_EQ(spawn_workers(2, copy, milliseconds(5000), OnLoss::stop, 0, handed), 0);
  EXPECT_EQ(spawn_workers(2, copy, milliseconds(5000), OnLoss::stop, 0), 14) << "closed where it is not handed";
  ::close(descriptor);
}

TEST_F(WorkerGroup, LostWorkersStopNoOtherWhereTheyGoOn) {
  EXPECT_EQ(spawn(4, "lossy", milliseconds(5000), OnLoss::go_on), 0);
  EXPECT_TRUE(exists("end3"));
  EXPECT_EQ(spawn(2, "killed", milliseconds(500), OnLoss::stop), kExitLostWorld);
  EXPECT_EQ(spawn(3, "fail", std::chrono::seconds(40), OnLoss::go_on), 5);  // an error of its own ends the run
}

// With --join; and an error of a restarted worker does not affect the others.
TEST_F(WorkerGroup, LostWorkersAreStartedAgain) {
  EXPECT_EQ(spawn(2, "restarted", milliseconds(5000), OnLoss::go_on, 2), 0);
  EXPECT_TRUE(exists("third"));
}

TEST_F(WorkerGroup, StubbornWorkerIsKilledAfterTheGraceTime) {
  const auto start = Clock::now();
  EXPECT_EQ(spawn(2, "stubborn", milliseconds(600)), 4);
  EXPECT_GE(seconds_since(start), 0.6);
  EXPECT_FALSE(is_running(pid(1)));
}

TEST_F(WorkerGroup, SignalsArePassedOn) {
  const pid_t parent = WorkerProcesses::start(0, [](int) { return spawn(2, "polite") == 0; });
  wait_for("pid0");
  wait_for("pid1");
  ::kill(parent, SIGTERM);
  int status = -1;
  ::waitpid(parent, &status, 0);
  EXPECT_EQ(status, 0);
  EXPECT_TRUE(exists("polite0") && exists("polite1"));
}

TEST_F(WorkerGroup, WorkersDieWithTheParent) {
  const pid_t parent = WorkerProcesses::start(0, [](int) { return spawn(2, "wait") == 0; });
  wait_for("pid0");
  wait_for("pid1");
  EXPECT_TRUE(is_running(pid(0)));
  ::kill(parent, SIGKILL);
  ::waitpid(parent, nullptr, 0);
  EXPECT_TRUE(is_gone_soon(pid(0)));
  EXPECT_TRUE(is_gone_soon(pid(1)));
}

TEST_F(WorkerGroup, ImpossibleNumbersAreInputErrors) {
  EXPECT_THROW(spawn_workers(0, {}), InputError);
  EXPECT_THROW(spawn_workers(1025, {}), InputError);
  EXPECT_THROW(spawn_workers(65, {}, std::chrono::seconds(5), OnLoss::go_on), InputError);
}

class WorkerEnvironment : public testing::Test {
 protected:
  void SetUp() override {
    set("EARSHOT_RANK", "1");
    set("EARSHOT_WORLD_SIZE", "2");
    set("EARSHOT_RENDEZVOUS", "tcp://127.0.0.1:5555");
    set("EARSHOT_RUN_ID", "run");
  }
  void TearDown() override {
    for (const char* name : {"EARSHOT_RANK", "EARSHOT_WORLD_SIZE", "EARSHOT_RENDEZVOUS", "EARSHOT_RUN_ID"}) ::unsetenv(name);
  }
  static void set(const char* name, const char* value) { ::setenv(name, value, 1); }
};

TEST_F(WorkerEnvironment, GivesTheIdentity) {
  const auto config = worker_from_environment();
  ASSERT_TRUE(config);
  EXPECT_EQ(config->ring.identity.rank, 1);
  EXPECT_EQ(config->ring.identity.world_size, 2);
  EXPECT_EQ(config->ring.rendezvous, "tcp://127.0.0.1:5555");
  EXPECT_EQ(config->ring.run_id, "run");
  TearDown();
  EXPECT_FALSE(worker_from_environment());
}

TEST_F(WorkerEnvironment, MeetingFolderOfALauncherLastsAsLongAsItsWorkers) {
  TearDown();
  const std::map<const char*, const char*> mpirun = {{"OMPI_COMM_WORLD_RANK", "1"},
                                                     {"OMPI_COMM_WORLD_SIZE", "2"},
                                                     {"OMPI_COMM_WORLD_LOCAL_SIZE", "2"},
                                                     {"PMIX_RANK", "1"},
                                                     {"PMIX_NAMESPACE", "worker-environment-test"}};
  for (const auto& [name, value] : mpirun) set(name, value);
  std::filesystem::path folder;
  {
    const auto first = worker_from_environment();
    ASSERT_TRUE(first);
    folder = first->folder;
    EXPECT_TRUE(std::filesystem::is_directory(folder));
    std::ofstream(folder / "a worker's socket") << "";
    worker_from_environment();  // another worker, which ends before the first
    EXPECT_TRUE(std::filesystem::is_directory(folder));
    std::filesystem::remove(folder / "a worker's socket");
  }
  EXPECT_FALSE(std::filesystem::exists(folder));
  for (const auto& [name, value] : mpirun) ::unsetenv(name);
}

TEST_F(WorkerEnvironment, ContradictionsAreInputErrors) {
  ::unsetenv("EARSHOT_RUN_ID");
  EXPECT_THROW(worker_from_environment(), InputError);
  SetUp();
  for (const char* rank : {"2", "-1", "", "one", "1x", "99999999999"}) {
    set("EARSHOT_RANK", rank);
    EXPECT_THROW(worker_from_environment(), InputError) << rank;
  }
  SetUp();
  set("EARSHOT_RENDEZVOUS", "tcp://192.168.0.7:5555");
  EXPECT_THROW(worker_from_environment(), InputError);
}

}  // namespace
}  // namespace earshot
