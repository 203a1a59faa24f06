// SPDX-License-Identifier: Apache-2.0
// Mesh files that people have: `earshot scene` and `rir` read all of their faces, or say which they do not.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/programs/mesh_cli.h"

namespace earshot {
namespace {

using random_rooms::Draws;
using random_rooms::Room;

std::string vertex_lines(const Room& room) {
  std::string text;
  for (const glm::dvec3 v : room.mesh.vertices) text += fmt::format("v {:.2f} {:.2f} {:.2f}\n", v.x, v.y, v.z);
  return text;
}

// Faces that name texture coordinates and normals which the file does not have, each corner form in turn.
TEST_F(MeshCli, ObjFacesWithoutTextureCoordinates) {
  expect_random_rooms(1, "a.obj", [](const Room& room, Draws& draws, std::uint32_t number) {
    std::string text = vertex_lines(room);
    if (draws.coin()) text += "vn 0 1 0\nvn 0 -1 0\n";
    if (number % 3 == 1) text += "vt 0 0\n";
    for (const glm::uvec3 t : room.mesh.triangles) {
      const auto form = draws.below(4);
      text += "f";
      for (int c = 0; c < 3; ++c) {
        const unsigned v = t[c] + 1, other = 1 + draws.below(8);
        text += form == 0   ? fmt::format(" {}", v)
                : form == 1 ? fmt::format(" {}/{}", v, other)
                : form == 2 ? fmt::format(" {}//{}", v, other)
                            : fmt::format(" {}/{}/{}", v, other, other);
      }
      text += "\n";
    }
    return text;
  });
  SKIP_WITHOUT_DATA("field/c24_no_vt_all.obj");
  expect_field_file("c24_no_vt_all.obj");
  expect_field_file("c24_no_vt_half.obj");
  expect_field_file("c24_no_vt_shell.obj", 14);
}

TEST_F(MeshCli, ObjCommentsBehindData) {
  expect_random_rooms(2, "a.obj", [](const Room& room, Draws& draws, std::uint32_t number) {
    const std::string plain = vertex_lines(room) + "usemtl wall\n";
    std::string text, lines = plain;
    for (const glm::uvec3 t : room.mesh.triangles) lines += fmt::format("f {} {} {}\n", t.x + 1, t.y + 1, t.z + 1);
    for (std::size_t begin = 0; begin < lines.size();) {
      const std::size_t end = lines.find('\n', begin);
      text += lines.substr(begin, end - begin);
      if (draws.coin()) text += (draws.coin() ? " # " : "\t#") + random_rooms::comment(draws);
      text += number % 2 ? "\r\n" : "\n";
      begin = end + 1;
    }
    return text;
  });
  SKIP_WITHOUT_DATA("field/c06_trailing_comments.obj");
  for (const char* name : {"c06_trailing_comments.obj", "c06_trailing_comments_faces.obj", "c06_trailing_comments_one.obj",
                           "c06_trailing_comments_words.obj", "c06_shift.obj"})
    expect_field_file(name);
}

// Walls of four corners over several lines, counted backwards, far from and before their vertices.
TEST_F(MeshCli, ObjContinuedLinesAndRelativeIndices) {
  expect_random_rooms(3, "a.obj", [](const Room& room, Draws& draws, std::uint32_t) {
    std::string text = vertex_lines(room);
    for (const std::array<int, 4>& strip : random_rooms::wall_strips()) {
      text += "f";
      for (const int corner : {strip[0], strip[1], strip[3], strip[2]}) {
        text += draws.coin() ? fmt::format(" {}", corner - 8) : fmt::format(" {}", corner + 1);
        if (draws.coin()) text += draws.coin() ? "  \\\n   " : " \\\r\n";
      }
      text += "\n";
    }
    return text;
  });
  SKIP_WITHOUT_DATA("field/c08_courtyard.obj");
  expect_field_file("c09_negative.obj");
  const std::string courtyard = (data_folder() / "field/c08_courtyard.obj").string();
  expect_room(courtyard, 40, 276, 1e-3);  // (12 x 8 + 7 x 2 - 6 x 3) x 3 m3, on a grid of 16,384 points
}

// Above 16 MiB, with and without a line break at the end.
TEST_F(MeshCli, LargeObjWithoutALastLineBreak) {
  expect_random_rooms(4, "a.obj", [](const Room& room, Draws& draws, std::uint32_t number) {
    const std::string padding = "# " + std::string(97, 'x') + "\n";
    std::string text;
    const std::size_t size = (std::size_t{16} << 20) + draws.below(3) * 4096 + draws.below(200);
    while (text.size() < size) text += padding;
    text += mesh_cases::obj_text(room.mesh);
    if (number % 4 != 3) text.pop_back();
    return text;
  });
}

TEST_F(MeshCli, PlyTriangleStrips) {
  expect_random_rooms(5, "a.ply", [](const Room& room, Draws& draws, std::uint32_t number) {
    const bool is_text = number % 3 == 0, is_big = number % 3 == 2;
    std::vector<std::vector<std::int32_t>> strips(1);
    for (const std::array<int, 4>& wall : random_rooms::wall_strips()) {
      if (!strips.back().empty() && draws.coin())
        strips.emplace_back();
      else if (!strips.back().empty())
        strips.back().push_back(-1);
      strips.back().insert(strips.back().end(), wall.begin(), wall.end());
    }
    std::string text = fmt::format(
        "ply\nformat {} 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
        "element tristrips {}\nproperty list int int vertex_indices\nend_header\n",
        is_text  ? "ascii"
        : is_big ? "binary_big_endian"
                 : "binary_little_endian",
        strips.size());
    random_rooms::Binary body(is_big);
    for (const glm::dvec3 v : room.mesh.vertices) {
      if (is_text) text += fmt::format("{} {} {}\n", v.x, v.y, v.z);
      for (int axis = 0; axis < 3; ++axis) body.add(static_cast<float>(v[axis]));
    }
    for (const auto& strip : strips) {
      if (is_text) text += fmt::format("{} {}\n", strip.size(), fmt::join(strip, " "));
      body.add(static_cast<std::int32_t>(strip.size()));
      for (const std::int32_t index : strip) body.add(index);
    }
    return is_text ? text : text + body.bytes;
  });
  SKIP_WITHOUT_DATA("field/c01_tristrips_ascii.ply");
  for (const char* name : {"c01_tristrips_ascii.ply", "c01_tristrips_binary.ply", "c01_control_faces.ply"}) expect_field_file(name);
}

TEST_F(MeshCli, PlyCommentsAnywhereInTheHeader) {
  expect_random_rooms(6, "a.ply", [](const Room& room, Draws& draws, std::uint32_t number) {
    using mesh_cases::PlyBody;
    constexpr std::array bodies{PlyBody::text, PlyBody::floats, PlyBody::floats_big_endian, PlyBody::doubles, PlyBody::doubles_big_endian};
    return random_rooms::with_comments(mesh_cases::ply_file(room.mesh, bodies[number % bodies.size()]), draws);
  });
  SKIP_WITHOUT_DATA("field/c26_comment_between.ply");
  for (const char* name : {"c26_comment_after_element.ply", "c26_comment_after_face.ply", "c26_comment_between.ply",
                           "c26_comment_colours.ply", "c26_empty_comment.ply", "c26_obj_info.ply"})
    expect_field_file(name);
}

// The first byte of the body is a line break, or another byte that a text would lose; header lines end in LF or CRLF.
TEST_F(MeshCli, PlyBinaryBodiesThatBeginWithABlank) {
  expect_random_rooms(7, "a.ply", [](const Room& room, Draws& draws, std::uint32_t number) {
    constexpr std::array<char, 5> bytes{'\n', '\r', '\v', ' ', '\t'};
    constexpr std::array kinds{"float", "double", "colour"};
    const std::string kind = kinds[number % kinds.size()];
    const char first_byte = number < 6 ? '\n' : bytes[draws.below(bytes.size())];
    const std::string type = kind == "double" ? "double" : "float";
    std::string header = "ply\nformat binary_little_endian 1.0\nelement vertex 8\n";
    if (kind == "colour") header += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    for (const char* axis : {"x", "y", "z"}) header += fmt::format("property {} {}\n", type, axis);
    header += "element face 12\nproperty list uchar int vertex_indices\nend_header\n";
    if (draws.coin()) {
      for (std::size_t at = 0; (at = header.find('\n', at)) != std::string::npos; at += 2) header.replace(at, 1, "\r\n");
    }
    random_rooms::Binary body(false);
    for (const glm::dvec3 v : room.mesh.vertices) {
      for (int i = 0; kind == "colour" && i < 3; ++i) body.add(static_cast<std::uint8_t>(first_byte));
      for (int axis = 0; axis < 3; ++axis) {
        // The lowest byte of a coordinate moves it by 6e-5 of itself at most; all corners that share it move alike.
        const auto with_low_byte = [&](auto number_bits, auto mask) {
          return (number_bits & ~mask) | static_cast<unsigned char>(first_byte);
        };
        if (kind == "double")
          body.add(std::bit_cast<double>(with_low_byte(std::bit_cast<std::uint64_t>(v[axis]), std::uint64_t{0xFF})));
        else
          body.add(std::bit_cast<float>(with_low_byte(std::bit_cast<std::uint32_t>(static_cast<float>(v[axis])), std::uint32_t{0xFF})));
      }
    }
    EXPECT_EQ(body.bytes[0], first_byte);
    for (const glm::uvec3 t : room.mesh.triangles) {
      body.add(std::uint8_t{3});
      for (int c = 0; c < 3; ++c) body.add(t[c]);
    }
    return header + body.bytes;
  });
  SKIP_WITHOUT_DATA("field/c25_first_byte_0a.ply");
  for (const char* name : {"c25_colour_first_0a.ply", "c25_double_0a.ply", "c25_first_byte_0a.ply", "c25_first_byte_0b.ply",
                           "c25_first_byte_0d.ply", "c25_first_byte_20.ply"})
    expect_field_file(name);
}

// Texts of any case and name, without an end, with decimal commas; binaries that call themselves solid or are padded.
TEST_F(MeshCli, StlVariants) {
  expect_random_rooms(8, "a.stl", [](const Room& room, Draws& draws, std::uint32_t number) {
    if (number % 2) {
      std::string bytes = mesh_cases::stl_binary(room.mesh);
      if (draws.coin()) bytes.replace(0, 11, draws.coin() ? "solid facet" : "solid room ");
      return bytes + std::string(draws.below(40), '\0');
    }
    std::string text = mesh_cases::stl_text(room.mesh);
    if (draws.coin()) text.replace(0, 10, "solid facet normal of outer loop");
    if (draws.coin()) text.resize(text.rfind("endsolid"));
    const bool is_upper = draws.coin(), has_commas = draws.coin();
    for (char& letter : text) {
      if (is_upper && letter >= 'a' && letter <= 'z') letter = static_cast<char>(letter - 32);
      if (has_commas && letter == '.') letter = ',';
    }
    return text;
  });
  SKIP_WITHOUT_DATA("field/c27_upper.stl");
  for (const char* name : {"c27_binary_solid_header.stl", "c27_binary_solid_trailing.stl", "c27_binary_trailing.stl", "c27_comma.stl",
                           "c27_name_facet.stl", "c27_no_endsolid.stl", "c27_upper.stl"})
    expect_field_file(name);
}

}  // namespace
}  // namespace earshot
