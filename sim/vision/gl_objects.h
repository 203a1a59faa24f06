// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <GLES3/gl3.h>

#include <utility>

namespace earshot {

/// Owner of one OpenGL name.  Made, used and destroyed on the thread whose context is current; zero: none.
template <void (*Generate)(GLsizei, GLuint*), void (*Delete)(GLsizei, const GLuint*)>
class GlObject {
 public:
  GlObject() { Generate(1, &name_); }
  ~GlObject() {
    if (name_ != 0) Delete(1, &name_);
  }
  GlObject(GlObject&& other) noexcept : name_(std::exchange(other.name_, 0)) {}
  GlObject& operator=(GlObject&& other) noexcept {
    std::swap(name_, other.name_);
    return *this;
  }
  [[nodiscard]] GLuint get() const { return name_; }

 private:
  GLuint name_ = 0;
};

using GlBuffer = GlObject<glGenBuffers, glDeleteBuffers>;
using GlVertexArray = GlObject<glGenVertexArrays, glDeleteVertexArrays>;
using GlTexture = GlObject<glGenTextures, glDeleteTextures>;
using GlRenderbuffer = GlObject<glGenRenderbuffers, glDeleteRenderbuffers>;
using GlFramebuffer = GlObject<glGenFramebuffers, glDeleteFramebuffers>;

/// Throws RunError that names what was done if OpenGL reports an error.
void check_gl(const char* doing);

}  // namespace earshot
