// SPDX-License-Identifier: Apache-2.0
#include "sim/vision/egl_program.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <numbers>
#include <string>

#include "sim/base/errors.h"
#include "sim/vision/gl_objects.h"

namespace earshot {
namespace {

constexpr const char* kVertexShader = R"(#version 300 es
precision highp float;
precision highp int;
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec3 color;
layout(location = 3) in vec2 uv;
layout(location = 4) in uint triangle;
uniform vec3 eye, right, up, forward;
uniform vec2 half_size;   // of the picture, on the plane one metre ahead
uniform float near_m;
out vec3 base_color;
out vec2 texture_uv;
flat out vec3 facing;     // the normal, toward the eye
flat out uint triangle_number;
void main() {
  vec3 seen = position - eye;
  float ahead = dot(seen, forward);
  // Rows count down, so up is negative.  z / w runs from -1 at near_m to 1 far away: there is no far plane.
  gl_Position = vec4(dot(seen, right) / half_size.x, -dot(seen, up) / half_size.y, ahead - 2.0 * near_m, ahead);
  base_color = color;
  texture_uv = uv;
  facing = dot(normal, seen) > 0.0 ? -normal : normal;
  triangle_number = triangle;
}
)";

// The light's constants stand before it.
constexpr const char* kFragmentShader = R"(
in vec3 base_color;
in vec2 texture_uv;
flat in vec3 facing;
flat in uint triangle_number;
uniform bool unlit, textured;
uniform highp sampler2D image;
uniform ivec2 wraps;      // TextureWrap
layout(location = 0) out uvec4 pixel;

int wrapped(int index, int size, int wrap) {
  if (wrap == 1) return clamp(index, 0, size - 1);
  int period = wrap == 2 ? 2 * size : size;
  // The sign of % is not defined for negative numbers.
  int inside = index >= 0 ? index % period : period - 1 - ((-1 - index) % period);
  return inside < size ? inside : period - 1 - inside;
}
vec3 texel(ivec2 at, ivec2 size) { return texelFetch(image, ivec2(wrapped(at.x, size.x, wraps.x), wrapped(at.y, size.y, wraps.y)), 0).rgb; }
vec3 sample_bilinear() {
  ivec2 size = textureSize(image, 0);
  vec2 at = clamp(texture_uv, -65536.0, 65536.0) * vec2(size) - 0.5;
  vec2 lower = floor(at);
  vec2 weight = at - lower;
  ivec2 first = ivec2(lower);
  return mix(mix(texel(first, size), texel(first + ivec2(1, 0), size), weight.x),
             mix(texel(first + ivec2(0, 1), size), texel(first + ivec2(1, 1), size), weight.x), weight.y);
}
vec3 encode_srgb(vec3 linear) {
  return mix(12.92 * linear, 1.055 * pow(max(linear, vec3(1e-6)), vec3(1.0 / 2.4)) - 0.055, step(vec3(0.0031308), linear));
}
void main() {
  vec3 color = base_color;
  if (textured) color *= sample_bilinear();
  if (!unlit) {
    float half_round = 0.5 + 0.5 * dot(facing, light_direction);
    color *= ambient_light + directed_light * half_round * half_round;
  }
  uvec3 bytes = uvec3(255.0 * encode_srgb(clamp(color, 0.0, 1.0)) + 0.5);
  pixel = uvec4(floatBitsToUint(1.0 / gl_FragCoord.w), bytes.r | bytes.g << 8 | bytes.b << 16, triangle_number, 0u);
}
)";

std::string fragment_shader() {
  const glm::vec3 light = kLightDirection;
  return fmt::format(
             "#version 300 es\nprecision highp float;\nprecision highp int;\n"
             "const vec3 light_direction = vec3({:.9f}, {:.9f}, {:.9f});\nconst float ambient_light = {:.9f}, directed_light = {:.9f};\n",
             light.x, light.y, light.z, kAmbientLight, kDirectedLight) +
         kFragmentShader;
}

/// A shader object while the program is linked.
struct Shader {
  GLuint name;
  Shader(GLenum stage, const char* text) : name(glCreateShader(stage)) {
    glShaderSource(name, 1, &text, nullptr);
    glCompileShader(name);
    GLint compiled = GL_FALSE;
    glGetShaderiv(name, GL_COMPILE_STATUS, &compiled);
    if (compiled == GL_TRUE) return;
    std::array<char, 512> log{};
    glGetShaderInfoLog(name, static_cast<GLsizei>(log.size()), nullptr, log.data());
    glDeleteShader(name);
    throw RunError("egl renderer", fmt::format("the driver cannot compile a shader: {}", log.data()));
  }
  ~Shader() { glDeleteShader(name); }
  Shader(const Shader&) = delete;
  Shader& operator=(const Shader&) = delete;
};

}  // namespace

struct EglProgram::Uniforms {
  GLint eye, right, up, forward, half_size, near_m, unlit, textured, image, wraps;
};

EglProgram::EglProgram() {
  const std::string fragments = fragment_shader();
  const Shader vertex(GL_VERTEX_SHADER, kVertexShader), fragment(GL_FRAGMENT_SHADER, fragments.c_str());
  program_ = glCreateProgram();
  glAttachShader(program_, vertex.name);
  glAttachShader(program_, fragment.name);
  glLinkProgram(program_);
  GLint linked = GL_FALSE;
  glGetProgramiv(program_, GL_LINK_STATUS, &linked);
  if (linked != GL_TRUE) {
    std::array<char, 512> log{};
    glGetProgramInfoLog(program_, static_cast<GLsizei>(log.size()), nullptr, log.data());
    glDeleteProgram(program_);
    throw RunError("egl renderer", fmt::format("the driver cannot link the shaders: {}", log.data()));
  }
  const auto at = [&](const char* name) { return glGetUniformLocation(program_, name); };
  uniforms_ = std::make_unique<Uniforms>(Uniforms{at("eye"), at("right"), at("up"), at("forward"), at("half_size"), at("near_m"),
                                                  at("unlit"), at("textured"), at("image"), at("wraps")});
}

EglProgram::~EglProgram() { glDeleteProgram(program_); }

void EglProgram::use() const {
  glUseProgram(program_);
  glUniform1i(uniforms_->image, 0);
  glUniform1f(uniforms_->near_m, kNearPlaneM);
}

void EglProgram::set_camera(const CameraSensorConfig& config, const CameraFrame& frame) const {
  const auto set = [](GLint location, glm::vec3 value) { glUniform3f(location, value.x, value.y, value.z); };
  set(uniforms_->eye, frame.eye);
  set(uniforms_->right, frame.right);
  set(uniforms_->up, frame.up);
  set(uniforms_->forward, frame.forward);
  const double half_width = std::tan(static_cast<double>(config.horizontal_fov_deg) * std::numbers::pi / 360.0);
  glUniform2f(uniforms_->half_size, static_cast<float>(half_width), static_cast<float>(half_width * config.height_px / config.width_px));
  glUniform1i(uniforms_->unlit, config.unlit ? 1 : 0);
}

void EglProgram::set_texture(const Texture* texture) const {
  glUniform1i(uniforms_->textured, texture ? 1 : 0);
  if (texture) glUniform2i(uniforms_->wraps, static_cast<GLint>(texture->wrap_u), static_cast<GLint>(texture->wrap_v));
}

void check_gl(const char* doing) {
  const GLenum error = glGetError();
  if (error == GL_NO_ERROR) return;
  throw RunError("egl renderer",
                 fmt::format("{} failed with OpenGL error 0x{:04X}{}", doing, error, error == GL_OUT_OF_MEMORY ? ", out of memory" : ""));
}

}  // namespace earshot
