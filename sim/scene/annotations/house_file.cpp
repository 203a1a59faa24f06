// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/annotations/house_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <unordered_map>
#include <vector>

#include "sim/base/errors.h"
#include "sim/scene/readers/text_scanner.h"

namespace earshot {
namespace {

class HouseParser {
 public:
  HouseParser(std::string_view text, const std::string& where) : where_(where), lines_(text), annotations_(where) {}

  Annotations parse() {
    while (lines_.next()) {
      split_words(lines_.line(), words_);
      if (words_.empty()) continue;
      if (words_[0] == "H") take_house();
      if (words_[0] == "C") take_category();
      if (words_[0] == "O") take_object();
    }
    if (!has_house_) throw InputError(where_, "is not a house file: it has no record H", "copy the file again");
    check_count("objects", num_objects_, objects_.size());
    check_count("categories", num_categories_, category_of_index_.size());
    for (const Object& object : objects_) annotations_.add(object.index, category_of(object));
    return std::move(annotations_);
  }

 private:
  struct Object {
    std::int64_t index, category;
    std::size_t line;
  };

  [[noreturn]] void fail(std::size_t line, const std::string& problem) const {
    throw InputError(fmt::format("{}:{}", where_, line), problem, "copy the file again");
  }

  void require_words(std::size_t count) const {
    if (words_.size() < count)
      fail(lines_.number(), fmt::format("a record {} has {} fields instead of {}", words_[0], words_.size() - 1, count - 1));
  }

  [[nodiscard]] std::int64_t whole(std::size_t word) const {
    const std::optional<std::int64_t> value = parse_whole(words_[word]);
    if (!value) fail(lines_.number(), fmt::format("field {} of a record {} is not a whole number", word, words_[0]));
    return *value;
  }

  void take_house() {
    if (has_house_) fail(lines_.number(), "a second record H");
    has_house_ = true;
    require_words(13);
    num_objects_ = whole(8);
    num_categories_ = whole(9);
  }

  void take_category() {
    require_words(6);
    std::string name(words_[5]);
    std::replace(name.begin(), name.end(), '#', ' ');
    const std::int64_t index = whole(1);
    if (!category_of_index_.try_emplace(index, std::move(name)).second) fail(lines_.number(), fmt::format("a second category {}", index));
  }

  void take_object() {
    require_words(16);
    objects_.push_back({whole(1), whole(3), lines_.number()});
  }

  void check_count(const char* what, std::int64_t promised, std::size_t found) const {
    if (promised != static_cast<std::int64_t>(found))
      throw InputError(where_, fmt::format("promises {} {} in its record H, but has {}", promised, what, found), "copy the file again");
  }

  [[nodiscard]] std::string category_of(const Object& object) const {
    if (object.category < 0) return {};
    const auto found = category_of_index_.find(object.category);
    if (found == category_of_index_.end())
      fail(object.line, fmt::format("object {} has the category {}, which does not exist", object.index, object.category));
    return found->second;
  }

  const std::string& where_;
  LineScanner lines_;
  std::vector<std::string_view> words_;
  Annotations annotations_;
  bool has_house_ = false;
  std::int64_t num_objects_ = 0, num_categories_ = 0;
  std::unordered_map<std::int64_t, std::string> category_of_index_;
  std::vector<Object> objects_;
};

}  // namespace

Annotations parse_house_file(std::string_view text, const std::string& where) { return HouseParser(text, where).parse(); }

}  // namespace earshot
