// SPDX-License-Identifier: Apache-2.0
// Numbers of configs: random values written in every way that is allowed are read exactly; everything else is refused.
#include "sim/base/text/config_number.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <cstdlib>
#include <limits>

#include "tests/support/configs/random_config.h"

namespace earshot {
namespace {

TEST(ConfigNumber, WholeNumbersAreDecimalInEveryForm) {
  for (std::uint32_t round = 0; round < 2000; ++round) {
    Draws draws(41, round);
    const std::int64_t value = static_cast<std::int64_t>(draws.below(std::size_t{1} << (1 + draws.below(30))));
    const std::string digits = std::to_string(value);
    const std::string zeros(draws.below(4), '0');
    const std::string sign = draws.one_in(3) ? "-" : draws.one_in(3) ? "+" : "";
    const std::int64_t expected = sign == "-" ? -value : value;
    const std::size_t cut = draws.below(digits.size() + 1);
    const std::size_t fraction = digits.size() - cut;
    const std::string point = digits.substr(0, cut) + "." + digits.substr(cut);
    const std::string shift = std::to_string(fraction);
    for (const std::string& text :
         {sign + zeros + digits, sign + zeros + digits + ".", sign + digits + ".000", sign + digits + "e0",
          sign + zeros + point + "e" + shift, sign + point + "E+0" + shift, sign + digits + "00e-2", sign + digits + "000.0E-3"})
      EXPECT_EQ(parse_whole<std::int64_t>(text), expected) << text;
    EXPECT_EQ(parse_whole<std::int64_t>(sign + digits + ".5"), std::nullopt);
    if (value % 10 != 0) {
      EXPECT_EQ(parse_whole<std::int64_t>(sign + digits + "e-1"), std::nullopt) << digits;
    }
  }
}

TEST(ConfigNumber, WholeNumbersAreExactUpToTheBoundsOfTheirType) {
  EXPECT_EQ(parse_whole<int>("010"), 10);
  EXPECT_EQ(parse_whole<int>("08"), 8);
  EXPECT_EQ(parse_whole<int>("3e6"), 3'000'000);
  EXPECT_EQ(parse_whole<int>("2147483647"), std::numeric_limits<int>::max());
  EXPECT_EQ(parse_whole<int>("2147483648"), std::nullopt);
  EXPECT_EQ(parse_whole<int>("-2.147483648e9"), std::numeric_limits<int>::min());
  EXPECT_EQ(parse_whole<std::uint64_t>("18446744073709551615"), std::numeric_limits<std::uint64_t>::max());
  EXPECT_EQ(parse_whole<std::uint64_t>("1.8446744073709551615e19"), std::numeric_limits<std::uint64_t>::max());
  EXPECT_EQ(parse_whole<std::uint64_t>("18446744073709551616"), std::nullopt);
  EXPECT_EQ(parse_whole<std::uint64_t>("1e400"), std::nullopt);
  EXPECT_EQ(parse_whole<std::uint64_t>("0e99999999999999999999"), 0u);
  EXPECT_EQ(parse_whole<std::uint64_t>("-1"), std::nullopt);
  EXPECT_EQ(parse_whole<std::int64_t>("9007199254740993"), 9007199254740993) << "not by way of a double";
}

TEST(ConfigNumber, NumbersAreTheNearestToTheirDigits) {
  for (std::uint32_t round = 0; round < 2000; ++round) {
    Draws draws(42, round);
    std::string text = draws.one_in(2) ? "-" : "";
    for (std::uint32_t i = 1 + draws.below(9); i > 0; --i) text += static_cast<char>('0' + draws.below(10));
    text += ".";
    for (std::uint32_t i = draws.below(12); i > 0; --i) text += static_cast<char>('0' + draws.below(10));
    if (draws.one_in(2)) text += "e" + std::to_string(static_cast<int>(draws.below(50)) - 25);
    EXPECT_EQ(parse_decimal<double>(text), std::strtod(text.c_str(), nullptr)) << text;
    EXPECT_EQ(parse_decimal<float>(text), std::strtof(text.c_str(), nullptr)) << text;
  }
  EXPECT_EQ(parse_decimal<double>("010"), 10.0);
  EXPECT_EQ(parse_decimal<double>("+.5"), 0.5);
  EXPECT_EQ(parse_decimal<double>("1e-05"), 1e-5);
}

TEST(ConfigNumber, NothingElseIsANumber) {
  for (const char* text :
       {"",      "-",   "+",    ".",   "e5",    "1e",  "1e+", "0x10", "0o17", "0b11", "1_000", "1,000",    "1:30", ".inf",
        "-.inf", "inf", ".nan", "nan", "1.2.3", "--1", "+-1", " 1",   "1 ",   "1f",   "0x1p3", "\xC2\xB2", "true", "~"}) {
    EXPECT_EQ(parse_whole<std::int64_t>(text), std::nullopt) << text;
    EXPECT_EQ(parse_decimal<double>(text), std::nullopt) << text;
    EXPECT_EQ(whole_digits(text), std::nullopt) << text;
  }
  EXPECT_EQ(parse_decimal<double>("1e400"), std::nullopt);
  EXPECT_EQ(parse_decimal<float>("1e39"), std::nullopt);
  for (const char* text : {"0x10", "0o17", "0b11", "1_000", "-1_0.5"}) EXPECT_NE(decimal_hint(text), "") << text;
  for (const char* text : {"", "a_b", "10", "x", "0", "house_1", "1_a"}) EXPECT_EQ(decimal_hint(text), "") << text;
}

}  // namespace
}  // namespace earshot
