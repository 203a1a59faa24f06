// SPDX-License-Identifier: Apache-2.0
#include "sim/vision/jpeg_bytes.h"

#include <turbojpeg.h>

#include <memory>
#include <type_traits>

#include "sim/base/errors.h"

namespace earshot {

std::string jpeg_bytes(int width_px, int height_px, std::span<const std::uint8_t> pixels, int quality) {
  const std::size_t size = static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px);
  const bool grey = pixels.size() == size;
  EARSHOT_EXPECT(grey || pixels.size() == 3 * size);
  EARSHOT_EXPECT(quality >= 1 && quality <= 100);
  const std::unique_ptr<std::remove_pointer_t<tjhandle>, decltype(&tjDestroy)> writer(tjInitCompress(), tjDestroy);
  if (!writer) throw RunError("libturbojpeg", "cannot be opened");
  unsigned char* bytes = nullptr;
  unsigned long count = 0;  // the library's type
  const int subsampling = grey ? TJSAMP_GRAY : quality < 90 ? TJSAMP_420 : TJSAMP_444;
  const int failed = tjCompress2(writer.get(), pixels.data(), width_px, 0, height_px, grey ? TJPF_GRAY : TJPF_RGB, &bytes, &count,
                                 subsampling, quality, TJFLAG_ACCURATEDCT);
  const std::unique_ptr<unsigned char, decltype(&tjFree)> release(bytes, tjFree);
  if (failed != 0) throw RunError("libturbojpeg", std::string("cannot write an image: ") + tjGetErrorStr2(writer.get()));
  return {reinterpret_cast<const char*>(bytes), count};
}

}  // namespace earshot
