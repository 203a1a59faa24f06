// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <signal.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include "sim/base/files.h"
#include "tests/support/wait_until.h"
#include "tests/support/workers/curve_ring.h"

namespace earshot {

inline bool has_program(const std::string& name) { return std::system(("command -v " + name + " >/dev/null 2>&1").c_str()) == 0; }

/// A Slurm on this machine: one node with two CPUs, or several nodes n1, n2, ... with one CPU each.  Its daemons run from a folder of the
/// test, without munge, systemd or cgroups, and end with it.  Sets SLURM_CONF for what the test starts.
class SlurmNode {
 public:
  explicit SlurmNode(const std::filesystem::path& folder, int num_nodes = 1) : folder_(folder) {
    if (::geteuid() != 0) {
      missing_ = "the daemons of Slurm need root";
      return;
    }
    for (const char* program : {"slurmctld", "slurmd", "srun", "sbatch", "scontrol"})
      if (!has_program(program)) {
        missing_ = std::string(program) + " is not installed (slurm-wlm)";
        return;
      }
    std::filesystem::create_directories(folder / "state");
    char host[256] = {};
    ::gethostname(host, sizeof(host) - 1);
    const std::string name = std::string(host).substr(0, std::string(host).find('.')), where = folder.string();
    std::vector<std::string> names;
    std::string nodes, all;
    for (int i = 1; i <= num_nodes; ++i) {
      names.push_back(num_nodes == 1 ? name : "n" + std::to_string(i));
      nodes += "NodeName=" + names.back() + " NodeHostname=" + name + " NodeAddr=127.0.0.1 Port=" + std::to_string(free_port()) +
               " CPUs=" + (num_nodes == 1 ? "2" : "1") + " State=UNKNOWN\n";
      all += (all.empty() ? "" : ",") + names.back();
    }
    std::ofstream(folder / "slurm.conf")
        << "ClusterName=test\nSlurmctldHost=" << name << "(127.0.0.1)\nSlurmctldPort=" << free_port()
        << "\nSlurmUser=root\nSlurmdUser=root\nAuthType=auth/none\nCredType=cred/none\n"
           "SlurmdParameters=config_overrides\nProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\nSelectType=select/cons_tres\n"
           "SelectTypeParameters=CR_Core\nReturnToService=2\nMpiDefault=none\nSwitchType=switch/none\n"
           "SchedulerParameters=sched_min_interval=0\nStateSaveLocation="
        << where << "/state\nSlurmdSpoolDir=" << where << "/spool.%n\nSlurmctldPidFile=" << where
        << "/slurmctld.pid\nSlurmdPidFile=" << where << "/slurmd.%n.pid\nSlurmctldLogFile=" << where
        << "/slurmctld.log\nSlurmdLogFile=" << where << "/slurmd.%n.log\n"
        << nodes << "PartitionName=all Nodes=" << all << " Default=YES State=UP\n";
    // Slurm 24 looks for control groups even where no plugin uses them; 22 does not know the word for none.
    if (std::system("slurmd -V | grep -qE ' (2[4-9]|[3-9][0-9])\\.'") == 0)
      std::ofstream(folder / "cgroup.conf") << "CgroupPlugin=disabled\n";
    ::setenv("SLURM_CONF", (folder / "slurm.conf").c_str(), 1);
    controller_ = start("slurmctld -D");
    for (const std::string& node : names) daemons_.push_back(start("slurmd -D -N " + node));
    const std::string up = "test $(sinfo -h -N -o %t 2>/dev/null | grep -c idle) = " + std::to_string(num_nodes);
    if (!wait_until([&] { return std::system(up.c_str()) == 0; }, 30))
      missing_ = "the daemons of Slurm did not come up within 30 s: " + where;
  }
  ~SlurmNode() {
    if (controller_ > 0)
      static_cast<void>(std::system("scancel --full --signal=KILL --user=root >/dev/null 2>&1; scontrol shutdown >/dev/null 2>&1"));
    daemons_.push_back(controller_);
    for (const pid_t pid : daemons_) {
      if (pid <= 0) continue;
      if (!wait_until([&] { return ::kill(pid, 0) != 0; }, 10)) ::kill(pid, SIGKILL);
    }
    ::unsetenv("SLURM_CONF");
  }
  SlurmNode(const SlurmNode&) = delete;
  SlurmNode& operator=(const SlurmNode&) = delete;

  /// Reason why Slurm is unavailable; empty if it is available.
  [[nodiscard]] const std::string& missing() const { return missing_; }

 private:
  /// A daemon in the background, not a child: no one has to wait for it.
  [[nodiscard]] pid_t start(const std::string& command) const {
    const std::string note = (folder_ / "started").string();
    if (std::system((command + " </dev/null >>" + (folder_ / "daemons.log").string() + " 2>&1 & echo $! >" + note).c_str()) != 0) return 0;
    return std::stoi(read_file(note));
  }

  std::filesystem::path folder_;
  std::string missing_;
  pid_t controller_ = 0;
  std::vector<pid_t> daemons_;
};

}  // namespace earshot
