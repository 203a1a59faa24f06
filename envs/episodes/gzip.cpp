// SPDX-License-Identifier: Apache-2.0
#include "envs/episodes/gzip.h"

#include <zlib.h>

#include <algorithm>
#include <limits>
#include <memory>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr int kGzipWindowBits = 15 + 16;  // zlib manual: 16 added to the window bits selects the gzip wrapper
constexpr std::size_t kChunkBytes = std::size_t{1} << 18;

struct EndInflate {
  void operator()(z_stream* stream) const noexcept { inflateEnd(stream); }
};
struct EndDeflate {
  void operator()(z_stream* stream) const noexcept { deflateEnd(stream); }
};

/// zlib counts in 32 bits: hand over at most that much at a time.
void feed(z_stream& stream, std::string_view bytes, std::size_t& consumed) {
  const std::size_t size = std::min<std::size_t>(bytes.size() - consumed, std::numeric_limits<uInt>::max());
  // zlib takes a non-const pointer and never writes through it.
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data() + consumed));
  stream.avail_in = static_cast<uInt>(size);
  consumed += size;
}

[[noreturn]] void fail(const std::string& where, const std::string& problem) {
  throw InputError(where, problem, "download or write the file again");
}

}  // namespace

bool is_gzip(std::string_view bytes) { return bytes.size() >= 2 && bytes[0] == '\x1f' && bytes[1] == '\x8b'; }

std::string gunzip(std::string_view bytes, const std::string& where, std::size_t max_bytes) {
  z_stream stream{};
  if (inflateInit2(&stream, kGzipWindowBits) != Z_OK) fail(where, "zlib cannot be initialised");
  const std::unique_ptr<z_stream, EndInflate> owner{&stream};

  std::string text;
  std::size_t consumed = 0;
  while (true) {
    if (stream.avail_in == 0 && consumed < bytes.size()) feed(stream, bytes, consumed);
    const std::size_t used = text.size();
    text.resize(std::min(used + std::max(kChunkBytes, used / 2), max_bytes + 1));
    stream.next_out = reinterpret_cast<Bytef*>(text.data() + used);
    const std::size_t room = text.size() - used;
    stream.avail_out = static_cast<uInt>(std::min<std::size_t>(room, std::numeric_limits<uInt>::max()));
    const uInt offered = stream.avail_out;
    const int status = inflate(&stream, Z_NO_FLUSH);
    text.resize(used + (offered - stream.avail_out));
    if (text.size() > max_bytes) fail(where, "its gzip stream contains more than " + std::to_string(max_bytes) + " bytes");
    if (status == Z_STREAM_END) {
      const std::string_view rest = bytes.substr(consumed - stream.avail_in);
      if (rest.find_first_not_of('\0') == std::string_view::npos) return text;  // nothing, or tape padding
      if (!is_gzip(rest)) fail(where, "has extra data after its gzip stream");
      inflateReset(&stream);
    } else if (status == Z_BUF_ERROR || (status == Z_OK && stream.avail_in == 0 && consumed == bytes.size() && stream.avail_out > 0)) {
      fail(where, "its gzip stream ends too early: the file is truncated");
    } else if (status != Z_OK) {
      fail(where, std::string("its gzip stream is corrupted (") + (stream.msg ? stream.msg : "no detail") + ")");
    }
  }
}

std::string gzip(std::string_view bytes) {
  z_stream stream{};
  if (deflateInit2(&stream, Z_DEFAULT_COMPRESSION, Z_DEFLATED, kGzipWindowBits, 8, Z_DEFAULT_STRATEGY) != Z_OK)
    throw RunError("gzip", "zlib cannot be initialised");
  const std::unique_ptr<z_stream, EndDeflate> owner{&stream};

  std::string packed;
  std::size_t consumed = 0;
  int status = Z_OK;
  while (status != Z_STREAM_END) {
    if (stream.avail_in == 0 && consumed < bytes.size()) feed(stream, bytes, consumed);
    const std::size_t used = packed.size();
    packed.resize(used + kChunkBytes);
    stream.next_out = reinterpret_cast<Bytef*>(packed.data() + used);
    stream.avail_out = static_cast<uInt>(kChunkBytes);
    status = deflate(&stream, consumed == bytes.size() ? Z_FINISH : Z_NO_FLUSH);
    packed.resize(used + (kChunkBytes - stream.avail_out));
  }
  return packed;
}

}  // namespace earshot
