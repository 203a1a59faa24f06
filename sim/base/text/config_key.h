// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace earshot {

/// Description of a key or of a section: sentences.  A text that is empty or does not end with a full stop does not compile.
class About {
 public:
  consteval About(const char* text) : text_(text) {  // NOLINT(google-explicit-constructor): a literal is what callers write
    if (text_.size() < 8 || text_.back() != '.') throw "a description is a sentence with its full stop";
  }
  [[nodiscard]] constexpr std::string_view text() const { return text_; }

 private:
  std::string_view text_;
};

/// The values that a key takes.  Bounds belong to the range unless they are open; those of a list hold for each of its items.
///
///   Allowed::between(0, 4)                          Allowed::above(0).up_to(60).or_word("auto", 0)
///   Allowed::at_least(0)                            Allowed::between(0.05, 100).interval()
///   Allowed::above(0).because("Adam divides by it")
struct Allowed {
  double low = -std::numeric_limits<double>::infinity(), high = std::numeric_limits<double>::infinity();
  bool is_low_open = false, is_high_open = false;
  std::optional<double> other = {};  ///< a value outside of the bounds that is taken too: 0 for "off"
  std::string_view word = {};        ///< text that stands for `other` in a file; empty: only the number does
  int multiple = 1;                  ///< whole numbers: a multiple of this
  int count = 0;                     ///< of a list: number of items; 0: any number
  bool is_interval = false;          ///< of a list of two numbers: the first is not the larger one
  bool accepts_scalar = false;       ///< of a list: a single item may stand without brackets
  std::string_view wanted = {};      ///< of text: its kind, "the name of a material"; empty: any text
  std::string_view reason = {};      ///< why no other value is taken, for messages; may be empty

  static constexpr Allowed any() { return {}; }
  static constexpr Allowed between(double low, double high) { return {.low = low, .high = high}; }
  static constexpr Allowed at_least(double low) { return {.low = low}; }
  static constexpr Allowed above(double low) { return {.low = low, .is_low_open = true}; }
  static constexpr Allowed text(std::string_view wanted) { return {.wanted = wanted}; }
  [[nodiscard]] constexpr Allowed up_to(double bound) const {
    Allowed copy = *this;
    copy.high = bound;
    return copy;
  }
  [[nodiscard]] constexpr Allowed below(double bound) const {
    Allowed copy = up_to(bound);
    copy.is_high_open = true;
    return copy;
  }
  [[nodiscard]] constexpr Allowed or_value(double value) const { return or_word({}, value); }
  [[nodiscard]] constexpr Allowed or_word(std::string_view text, double value) const {
    Allowed copy = *this;
    copy.word = text;
    copy.other = value;
    return copy;
  }
  [[nodiscard]] constexpr Allowed multiple_of(int factor) const {
    Allowed copy = *this;
    copy.multiple = factor;
    return copy;
  }
  [[nodiscard]] constexpr Allowed items(int number) const {
    Allowed copy = *this;
    copy.count = number;
    return copy;
  }
  [[nodiscard]] constexpr Allowed interval() const {
    Allowed copy = items(2);
    copy.is_interval = true;
    return copy;
  }
  [[nodiscard]] constexpr Allowed or_single() const {
    Allowed copy = *this;
    copy.accepts_scalar = true;
    return copy;
  }
  [[nodiscard]] constexpr Allowed because(std::string_view why) const {
    Allowed copy = *this;
    copy.reason = why;
    return copy;
  }
};

enum class KeyType { section, flag, whole_number, number, text, choice, whole_numbers, numbers, texts, nested_numbers };

/// One key as its reader declares it, for the reference of all keys.
struct ConfigKey {
  std::string name;  ///< with the sections it lies in, "env.acoustics.rays"; a part in capitals stands for any name
  KeyType type = KeyType::text;
  Allowed allowed = {};  ///< of whole numbers with the bounds of their type
  std::vector<std::string> choices = {};
  std::optional<std::string> default_value = {};  ///< as YAML; nothing: without the key, nothing is set
  bool is_required = false;
  std::string about = {};
};

/// Unit by the suffix of the last part of a key: "s" of time_bin_s; empty without one.
std::string unit_of_key(std::string_view name);
/// 1,048,576; 0.00001; 2^64 - 1.
std::string number_text(double value);
/// "whole number", "list of numbers".
std::string type_text(const ConfigKey& key);
/// "0 to 4", "above 0, at most 60, or auto", "fast, balanced or high"; empty where every value of the type is taken.
std::string allowed_text(const ConfigKey& key);
/// Allowed values, for messages: "a whole number from 1 to 1,048,576".
std::string wanted_text(const ConfigKey& key);

}  // namespace earshot
