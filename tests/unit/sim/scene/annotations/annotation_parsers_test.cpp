// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <string>

#include "sim/base/errors.h"
#include "sim/scene/annotations/annotation_files.h"
#include "sim/scene/annotations/house_file.h"
#include "sim/scene/annotations/replica_info.h"
#include "sim/scene/annotations/semantic_text.h"
#include "tests/support/files/annotated_room.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::HasSubstr;

std::string category_of(const Annotations& annotations, std::int64_t id) { return annotations.names()[annotations.of_id(id)].category; }

TEST(AnnotationParsers, EveryInstanceHasItsCategory) {
  for (std::uint32_t i = 0; i < 8; ++i) {
    const AnnotatedRoom room(300 + i, i);
    const Annotations house = parse_house_file(room.house(), "a.house"), info = parse_replica_info(room.replica_info(i % 2 == 0), "i.json"),
                      text = parse_semantic_text(room.semantic_text(), "a.semantic.txt");
    for (const AnnotatedRoom::Face& face : room.faces) {
      const std::string category = room.category_of(face);
      EXPECT_EQ(category_of(house, face.id), category);
      EXPECT_EQ(category_of(info, face.id), category);
      EXPECT_EQ(category_of(text, face.id), category);
      EXPECT_EQ(text.names()[text.of_color(room.color_of(face))].category, category);
      const std::string object = category == "unlabelled" ? category : fmt::format("{}_{}", category, face.id);
      EXPECT_EQ(house.names()[house.of_id(face.id)].object, object);
    }
    EXPECT_EQ(text.of_color(0x010203u), 0u);
  }
}

// ReplicaCAD lists classes alone: the ids are theirs.
TEST(AnnotationParsers, ClassesAloneAreTheInstances) {
  const Annotations classes = parse_replica_info(R"({"classes": [{"id": 4, "name": "rug"}, {"id": 9, "name": "wall"}]})", "i.json");
  EXPECT_EQ(category_of(classes, 9), "wall");
  EXPECT_EQ(category_of(classes, 5), "unlabelled");
}

TEST(AnnotationParsers, LineEndsOfOtherSystemsAreRead) {
  const AnnotatedRoom room(320);
  for (std::string text : {room.semantic_text(), room.house()}) {
    std::string crlf;
    for (const char letter : text) crlf += letter == '\n' ? std::string("\r\n") : std::string(1, letter);
    const Annotations annotations = text.starts_with("HM3D") ? parse_semantic_text(crlf, "a") : parse_house_file(crlf, "a");
    EXPECT_EQ(annotations.names().size(), 1 + room.instances.size());
  }
}

// A category may hold commas, and no name is taken for another's.
TEST(AnnotationParsers, NamesMayHoldCommas) {
  const Annotations text = parse_semantic_text("HM3D Semantic Annotations\n1,0000ff,\"cup, mug\",3\n2,0000FE,\"\",-1\n", "a");
  EXPECT_EQ(category_of(text, 1), "cup, mug");
  EXPECT_EQ(text.of_color(0xFF), text.of_id(1));
  EXPECT_EQ(category_of(text, 2), "unlabelled");
}

// Wherever the file ends early, it is refused, or all that it holds is whole: no instance gets another category than its own.
TEST(AnnotationParsers, CutFilesAreRefusedOrWhole) {
  for (std::uint32_t i = 0; i < 3; ++i) {
    const AnnotatedRoom room(340 + i);
    using Parse = std::function<Annotations(const std::string&)>;
    const std::pair<std::string, Parse> formats[] = {
        {room.house(), [](const std::string& text) { return parse_house_file(text, "file"); }},
        {room.replica_info(), [](const std::string& text) { return parse_replica_info(text, "file"); }},
        {room.semantic_text(), [](const std::string& text) { return parse_semantic_text(text, "file"); }}};
    for (const auto& [whole, parse] : formats) {
      for (std::size_t size = 0; size < whole.size(); ++size) {
        try {
          const Annotations cut = parse(whole.substr(0, size));
          for (const auto& [id, instance] : room.instances)
            EXPECT_THAT(category_of(cut, id), testing::AnyOf(instance.category, "unlabelled")) << size;
        } catch (const InputError& error) {
          EXPECT_THAT(error.what(), HasSubstr("file"));
          EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
        }
      }
    }
  }
}

TEST(AnnotationParsers, RefusalsNameThePlace) {
  const auto house = [](const std::string& text) { return message_of<InputError>([&] { parse_house_file(text, "a.house"); }); };
  const std::string head = "H room label 0 0 0 0 0 1 1 1 0 1 0 0 0 0 0 0 0 0 9 9 9 0 0 0 0 0\n",
                    object = " 0 0 0 0 1 0 0 0 1 0 1 2 3 0 0 0 0 0 0 0 0\n", category = "C 0 3 raw 3 wall 0 0 0\n";
  EXPECT_EQ(house(head + category + "O 7 0 0" + object), "");
  EXPECT_THAT(house(category), HasSubstr("no record H"));
  EXPECT_THAT(house(head + category), HasSubstr("promises 1 objects in its record H, but has 0"));
  EXPECT_THAT(house(head + category + "O 7 0 5" + object), HasSubstr("a.house:3: object 7 has the category 5, which does not exist"));
  EXPECT_THAT(house(head + category + "O x 0 0" + object), HasSubstr("a.house:3: field 1 of a record O is not a whole number"));
  EXPECT_THAT(house(head + "C 0 3 raw\n"), HasSubstr("a.house:2: a record C has 3 fields instead of 5"));
  EXPECT_THAT(house(head + category + category), HasSubstr("a second category 0"));
  const auto info = [](const std::string& text) { return message_of<InputError>([&] { parse_replica_info(text, "i.json"); }); };
  EXPECT_THAT(info("{}"), HasSubstr("neither 'classes' nor 'objects'"));
  EXPECT_THAT(info(R"({"objects": {}})"), HasSubstr("'objects' is not a list"));
  EXPECT_THAT(info(R"({"objects": [{"id": 1.5, "class_name": "wall"}]})"), HasSubstr("objects[0].id is not a whole number"));
  EXPECT_THAT(info(R"({"objects": [{"id": 1, "class_id": 2}]})"), HasSubstr("the class 2 does not exist"));
  EXPECT_THAT(info(R"({"objects": [{"id": 1, "class_name": "a"}, {"id": 1, "class_name": "b"}]})"), HasSubstr("two entries with the id 1"));
  std::string many = R"({"objects": [)";
  for (int i = 0; i < 600'000; ++i) many += "[],";
  EXPECT_THAT(info(many + "[]]}"), HasSubstr("i.json: holds more than 500000 lists and maps"));
  const auto text = [](const std::string& lines) {
    return message_of<InputError>([&] { parse_semantic_text("HM3D Semantic Annotations\n" + lines, "a.semantic.txt"); });
  };
  for (const char* line : {"1,FF00,\"wall\",0", "1,FF00GG,\"wall\",0", "x,FF0000,\"wall\",0", "1,FF0000,wall,0", "1,FF0000,\"wall\",", "1"})
    EXPECT_THAT(text(std::string("0,000001,\"door\",0\n") + line), HasSubstr("a.semantic.txt:3: is not an instance of HM3D")) << line;
  EXPECT_THAT(text("1,FF0000,\"wall\",0\n2,ff0000,\"door\",0\n"), HasSubstr("gives the color FF0000 to two entries"));
  EXPECT_THAT(message_of<InputError>([] { parse_semantic_text("", "a.semantic.txt"); }), HasSubstr("does not begin with"));
  EXPECT_THAT(message_of<InputError>([] { read_annotations("a.scn"); }), HasSubstr("a.scn: is not a file of annotations that is read"));
}

}  // namespace
}  // namespace earshot
