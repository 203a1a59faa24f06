// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/host_address.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim/base/errors.h"
#include "trainer/net/ring_config.h"

namespace earshot {
namespace {

using testing::HasSubstr;

TEST(HostAddress, TcpAddressesHaveAHostAndAPort) {
  const auto expect = [](const char* text, const char* host, int port) {
    const TcpAddress address = parse_tcp(text);
    EXPECT_EQ(address.host, host) << text;
    EXPECT_EQ(address.port, port) << text;
    EXPECT_EQ(address.endpoint(), text);
  };
  expect("tcp://10.0.0.1:80", "10.0.0.1", 80);
  expect("tcp://train-0.train:29400", "train-0.train", 29400);
  expect("tcp://[fd00::1]:65535", "fd00::1", 65535);
  expect("tcp://127.0.0.1:*", "127.0.0.1", 0);
  expect("tcp://[::1]:29400", "::1", 29400);
  expect("tcp://localhost:29400", "localhost", 29400);
  for (const char* text : {"",
                           "tcp://",
                           "tcp://:80",
                           "tcp://h",
                           "tcp://h:",
                           "tcp://h:0",
                           "tcp://h:65536",
                           "tcp://h:8x",
                           "tcp://h:-1",
                           "tcp://*:80",
                           "tcp://fd00::1:80",
                           "tcp://[h]:80",
                           "tcp://[]:80",
                           "udp://h:80",
                           "tcp://h h:80",
                           "tcp://h/x:80",
                           "tcp://h\n:80",
                           "tcp://::1:80",
                           "tcp://[::1]",
                           "tcp://[::1:80",
                           "tcp://::1]:80",
                           "tcp://[::1]80",
                           "tcp://[[::1]]:80",
                           "tcp://[::1]:29500:80",
                           "tcp://[127.0.0.1]:80",
                           "[::1]:80",
                           "localhost:80"})
    EXPECT_THROW(parse_tcp(text), InputError) << text;
}

TEST(HostAddress, OnlyTheLoopbackInterfaceIsLoopback) {
  for (const char* host : {"localhost", "127.0.0.1", "127.0.1.1", "::1"}) EXPECT_TRUE(is_loopback(host)) << host;
  for (const char* host :
       {"10.0.0.1", "127.0.0.1.example.com", "128.0.0.1", "fd00::1", "::", "0.0.0.0", "127", "localhost.example.com", ""})
    EXPECT_FALSE(is_loopback(host)) << host;
}

TEST(HostAddress, NamesAndInterfacesBecomeNumbers) {
  const auto now = std::chrono::steady_clock::now();
  EXPECT_EQ(resolve("localhost", now), "127.0.0.1");
  EXPECT_EQ(resolve("192.0.2.7", now), "192.0.2.7");
  EXPECT_EQ(resolve("fd00::7", now), "fd00::7");
  EXPECT_EQ(resolve("::1", now), "::1");
  EXPECT_THROW(resolve("no-such-host.invalid", now), UnknownHost);
  EXPECT_THROW(resolve("127.0.0.1.", now), InputError);
  EXPECT_EQ(local_address_towards({"127.0.0.1", 80}), "127.0.0.1");
  EXPECT_EQ(address_of_interface("lo", ""), "127.0.0.1");
  EXPECT_EQ(address_of_interface("127.0.0.1", "10.0.0.1"), "127.0.0.1");
  try {
    address_of_interface("eth77", "");
    ADD_FAILURE();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("lo"));
  }
}

TEST(NetworkConfig, PortRangesAndKeysAreChecked) {
  const auto ports = [](const char* text) {
    NetworkConfig config;
    config.port_range = text;
    return ports_of(config);
  };
  EXPECT_EQ(ports("").first, 0);
  EXPECT_EQ(ports("20000-20100").first, 20000);
  EXPECT_EQ(ports("20000-20100").last, 20100);
  EXPECT_EQ(ports("7-7").last, 7);
  for (const char* text : {"7", "7-", "-7", "8-7", "0-7", "7-65536", "7-8x", "a-b", "7 - 8", "99999999999-7"})
    EXPECT_THROW(ports(text), InputError) << text;

  const auto refusal = [](auto change) {
    NetworkConfig config;
    change(config);
    EXPECT_THROW(validate(config), InputError);
  };
  refusal([](NetworkConfig& c) { c.insecure = true, c.curve_key_file = "keys"; });
  refusal([](NetworkConfig& c) { c.allow_list = "list"; });
  refusal([](NetworkConfig& c) { c.meeting_key = std::string(40, 'a'); });
  refusal([](NetworkConfig& c) { c.curve_key_file = "keys", c.meeting_key = "short"; });
  EXPECT_NO_THROW(validate(NetworkConfig{}));
}

}  // namespace
}  // namespace earshot
