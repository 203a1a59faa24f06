// SPDX-License-Identifier: Apache-2.0
// A program that misbehaves as it is told, for isolated_call_test.cpp.
#include <sys/resource.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/process/isolated_call.h"

namespace {

constexpr int kAnswerDescriptor = 3;

volatile int* nowhere = nullptr;

int recurse(int depth) {  // NOLINT(misc-no-recursion)
  volatile char page[4096] = {};
  page[depth % 4096] = 1;
  return depth < 0 ? 0 : recurse(depth + 1) + page[0];
}

[[noreturn]] void send(const std::string& bytes) {
  std::size_t sent = 0;
  while (sent < bytes.size()) {
    const ssize_t count = ::write(kAnswerDescriptor, bytes.data() + sent, bytes.size() - sent);
    if (count <= 0) break;
    sent += static_cast<std::size_t>(count);
  }
  ::_exit(0);
}

std::string misbehave(const std::vector<std::string>& arguments) {
  using namespace earshot;
  const std::string& mode = arguments.at(0);
  if (mode == "echo") return arguments.at(1);
  if (mode == "large") return std::string(std::stoul(arguments.at(1)), 'x');
  if (mode == "print") {
    std::puts("noise on stdout");
    std::fputs("noise on stderr\n", stderr);
    std::fflush(stdout);
    return "quiet";
  }
  if (mode == "refuse") throw InputError(arguments.at(1), "is of no use", "take another");
  if (mode == "throw") throw std::runtime_error("a library gave up");
  if (mode == "segv") *nowhere = 1;
  if (mode == "abort") std::abort();
  if (mode == "overflow") return std::to_string(recurse(0));
  if (mode == "exit") ::_exit(3);
  if (mode == "leave") ::_exit(0);
  if (mode == "sleep") ::sleep(1000);
  if (mode == "spin")
    for (volatile unsigned turns = 0;;) turns = turns + 1;
  if (mode == "deaf") {  // to the polite signals
    for (const int signal : {SIGTERM, SIGINT, SIGHUP, SIGPIPE}) std::signal(signal, SIG_IGN);
    for (;;) ::sleep(1000);
  }
  if (mode == "allocate") {  // in blocks of the given size, every page touched
    const std::size_t block = std::stoul(arguments.at(1));
    std::vector<std::unique_ptr<char[]>> blocks;
    for (std::size_t total = 0; total < (std::size_t{8} << 30); total += block) {
      blocks.push_back(std::make_unique<char[]>(block));
      for (std::size_t at = 0; at < block; at += 4096) blocks.back()[at] = 1;
    }
    return "had it all";
  }
  if (mode == "write") {
    std::FILE* file = std::fopen(arguments.at(1).c_str(), "w");
    if (file) std::fputs("written", file);
    if (file) std::fclose(file);
    return "wrote";
  }
  const std::string answer(1000, 'y');
  const std::string header = answer_header(AnswerKind::answer, answer);
  if (mode == "half") send(header + answer.substr(0, 500));
  if (mode == "header") send(header.substr(0, 20));
  if (mode == "garbage") send(std::string(5000, '\x5A'));
  if (mode == "flipped") send(header + answer.substr(0, 999) + 'z');
  if (mode == "huge") {
    std::string lie = header;
    for (std::size_t at = 16; at < 24; ++at) lie[at] = '\x7F';  // its length
    send(lie + answer);
  }
  if (mode == "half_then_sleep") {
    static_cast<void>(::write(kAnswerDescriptor, header.data(), header.size()));
    ::sleep(1000);
  }
  throw InputError(mode, "is no way to misbehave", "");
}

}  // namespace

int main(int argc, char** argv) { return earshot::answer_isolated(argc, argv, misbehave); }
