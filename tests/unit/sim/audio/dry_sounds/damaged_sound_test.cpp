// SPDX-License-Identifier: Apache-2.0
// Sound files that are cut, flipped or of unknown length: a sound is refused or read whole, never shorter than its file states.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sndfile.h>

#include <cstdint>
#include <string>
#include <vector>

#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "tests/support/files/test_data.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using ::testing::HasSubstr;

constexpr int kFrames = 6001;

/// A container and the way in which it holds samples.
struct SoundFormatPair {
  int format = 0;
  std::string ending, name;
};

/// All that libsndfile writes, and whose samples it finds again without being told how they lie (not RAW, not SD2 in two files).
std::vector<SoundFormatPair> written_formats() {
  int containers = 0, subtypes = 0;
  sf_command(nullptr, SFC_GET_FORMAT_MAJOR_COUNT, &containers, sizeof containers);
  sf_command(nullptr, SFC_GET_FORMAT_SUBTYPE_COUNT, &subtypes, sizeof subtypes);
  std::vector<SoundFormatPair> pairs;
  for (int c = 0; c < containers; ++c) {
    SF_FORMAT_INFO container{}, subtype{};
    container.format = c;
    sf_command(nullptr, SFC_GET_FORMAT_MAJOR, &container, sizeof container);
    if (container.format == SF_FORMAT_RAW || container.format == SF_FORMAT_SD2) continue;
    for (int s = 0; s < subtypes; ++s) {
      subtype.format = s;
      sf_command(nullptr, SFC_GET_FORMAT_SUBTYPE, &subtype, sizeof subtype);
      const bool is_mp3 = container.format == SF_FORMAT_MPEG;
      pairs.push_back(
          {container.format | subtype.format, is_mp3 ? "mp3" : container.extension, std::string(container.name) + ", " + subtype.name});
    }
  }
  return pairs;
}

class DamagedSound : public ::testing::Test {
 protected:
  /// The bytes of noise in a format; empty where libsndfile does not write it.
  std::string encoded(int format, const std::string& ending, int frames = kFrames, int channels = 1) const {
    SF_INFO info{};
    info.samplerate = 16000;
    info.channels = channels;
    info.format = format;
    if (!sf_format_check(&info)) info.samplerate = 8000;
    if (!sf_format_check(&info)) return {};
    const std::string path = folder_ / ("whole." + ending);
    SNDFILE* out = sf_open(path.c_str(), SFM_WRITE, &info);
    if (!out) return {};
    const RandomStream random(7, Purpose::test);
    std::vector<float> noise(static_cast<std::size_t>(frames * channels));
    for (std::size_t i = 0; i < noise.size(); ++i) noise[i] = 0.4f * random.uniform(static_cast<std::uint32_t>(i)) - 0.2f;
    const sf_count_t written = sf_writef_float(out, noise.data(), frames);
    sf_close(out);
    return written > 0 ? read_file(path) : std::string();
  }

  std::vector<float> read(const std::string& bytes, const std::string& ending) const {
    return load_sound_channels(folder_.write("a." + ending, bytes)).samples;
  }

  /// Why the bytes are refused; empty where they are read.
  std::string refusal(const std::string& bytes, const std::string& ending) const {
    std::string message;
    try {
      read(bytes, ending);
    } catch (const InputError& error) {
      message = error.what();
      EXPECT_THAT(message, HasSubstr("a." + ending));
      EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    }
    return message;
  }

  TempFolder folder_;
};

std::string with(std::string bytes, std::size_t place, const std::string& other) { return bytes.replace(place, other.size(), other); }

std::string number(std::uint64_t value, int width, bool is_big_endian) {
  std::string bytes;
  for (int i = 0; i < width; ++i) bytes += static_cast<char>(value >> (8 * (is_big_endian ? width - 1 - i : i)) & 0xFF);
  return bytes;
}

TEST_F(DamagedSound, EveryFormatIsRefusedOrReadWholeWhereverItIsCut) {
  const RandomStream random(1, Purpose::test);
  std::uint32_t draw = 0;
  int checked = 0, refused_containers = 0, cuts_refused = 0;
  for (const SoundFormatPair& pair : written_formats()) {
    const std::string bytes = encoded(pair.format, pair.ending);
    if (bytes.empty()) continue;
    const std::string message = refusal(bytes, pair.ending);
    if (!message.empty()) {
      // Of headers that state no length, and of containers that hardly anyone has, a cut cannot be told: none of them is read.
      EXPECT_THAT(message, HasSubstr("in which a truncated file cannot be detected")) << pair.name;
      ++refused_containers;
      continue;
    }
    const std::vector<float> whole = read(bytes, pair.ending);
    EXPECT_GE(whole.size(), kFrames) << pair.name;
    ++checked;
    for (int cut = 0; cut < 20; ++cut) {
      const std::size_t size = random.below(static_cast<std::uint32_t>(bytes.size()), draw++);
      const std::string why = refusal(bytes.substr(0, size), pair.ending);
      if (why.empty()) {
        EXPECT_EQ(read(bytes.substr(0, size), pair.ending), whole) << pair.name << " cut at " << size;
      }
      cuts_refused += !why.empty();
    }
  }
  EXPECT_GE(checked, 50);
  EXPECT_GE(refused_containers, 10);
  EXPECT_GE(cuts_refused, 19 * checked);
}

// A FLAC has a checksum for each frame, Ogg one for each page.  The other containers have none: a flipped bit is another sound.
TEST_F(DamagedSound, FlippedBitsInFlacAndOggAreRefused) {
  const RandomStream random(2, Purpose::test);
  std::uint32_t draw = 0;
  for (const int format : {SF_FORMAT_FLAC | SF_FORMAT_PCM_S8, SF_FORMAT_FLAC | SF_FORMAT_PCM_16, SF_FORMAT_FLAC | SF_FORMAT_PCM_24,
                           SF_FORMAT_OGG | SF_FORMAT_VORBIS, SF_FORMAT_OGG | SF_FORMAT_OPUS}) {
    const bool is_flac = (format & SF_FORMAT_TYPEMASK) == SF_FORMAT_FLAC;
    const std::string ending = is_flac ? "flac" : "ogg", bytes = encoded(format, ending);
    ASSERT_FALSE(bytes.empty());
    std::size_t first = 0;
    if (is_flac) {  // behind the blocks of metadata
      const auto byte = [&](std::size_t at) { return static_cast<std::size_t>(static_cast<unsigned char>(bytes[at])); };
      bool is_last = false;
      for (first = 4; !is_last;) {
        is_last = (byte(first) & 0x80) != 0;
        first += 4 + (byte(first + 1) << 16 | byte(first + 2) << 8 | byte(first + 3));
      }
    }
    for (int trial = 0; trial < 60; ++trial) {
      std::string flipped = bytes;
      const std::size_t place = first + random.below(static_cast<std::uint32_t>(bytes.size() - first), draw++);
      flipped[place] = static_cast<char>(flipped[place] ^ 1 << random.below(8, draw++));
      EXPECT_NE(refusal(flipped, ending), "") << std::hex << format << " at " << std::dec << place;
    }
  }
}

TEST_F(DamagedSound, StreamsOfUnknownLengthAreReadWhole) {
  const auto whole_of = [&](const std::string& bytes, const std::string& ending) { return read(bytes, ending); };
  const std::string wav = encoded(SF_FORMAT_WAV | SF_FORMAT_PCM_16, "wav", kFrames, 2);
  const std::size_t data = wav.find("data");
  for (const std::uint64_t riff : {0x0u, 0x8u, 0x24u, 0xFFFFFFFFu})
    for (const std::uint64_t size : {0x0u, 0x7FFFF000u, 0x80000000u, 0xFFFFFFFFu, 0xFFFFFFDBu}) {
      const std::string piped = with(with(wav, 4, number(riff, 4, false)), data + 4, number(size, 4, false));
      EXPECT_EQ(whole_of(piped, "wav"), whole_of(wav, "wav")) << std::hex << riff << ' ' << size;
    }
  const std::string aiff = encoded(SF_FORMAT_AIFF | SF_FORMAT_PCM_16, "aiff");
  for (const std::uint64_t size : {0x0u, 0x7F000000u, 0xFFFFFFFFu})
    EXPECT_EQ(whole_of(with(aiff, aiff.find("SSND") + 4, number(size, 4, true)), "aiff"), whole_of(aiff, "aiff")) << size;
  const std::string au = encoded(SF_FORMAT_AU | SF_FORMAT_PCM_16, "au");
  for (const std::uint64_t size : {0x0u, 0x7F000000u, 0xFFFFFFFFu})
    EXPECT_EQ(whole_of(with(au, 8, number(size, 4, true)), "au"), whole_of(au, "au")) << size;
  const std::string caf = encoded(SF_FORMAT_CAF | SF_FORMAT_PCM_16, "caf");
  EXPECT_EQ(whole_of(with(caf, caf.rfind("data") + 4, std::string(8, '\xFF')), "caf"), whole_of(caf, "caf"));
  const std::string flac = encoded(SF_FORMAT_FLAC | SF_FORMAT_PCM_16, "flac");  // 36 bits from bit 4 of byte 21 on
  const std::string unknown = with(flac, 21, std::string(1, static_cast<char>(flac[21] & 0xF0)) + std::string(4, '\0'));
  EXPECT_EQ(whole_of(unknown, "flac"), whole_of(flac, "flac"));
  EXPECT_NE(refusal(unknown.substr(0, unknown.size() / 2), "flac"), "");  // inside a frame; between two frames nothing tells
}

TEST_F(DamagedSound, AnEmptyChunkOfSoundBeforeOthersIsEmpty) {
  const std::string wav = encoded(SF_FORMAT_WAV | SF_FORMAT_PCM_16, "wav");
  const std::string head = wav.substr(0, wav.find("data"));
  const std::string empty = head + "data" + number(0, 4, false) + "LIST" + number(4, 4, false) + "INFO";
  EXPECT_THAT(refusal(empty, "wav"), HasSubstr("contains no samples"));
  const std::string tagged = wav + std::string(wav.size() % 2, '\0') + "LIST" + number(20, 4, false) + "INFO";  // the list is cut
  EXPECT_EQ(read(tagged, "wav"), read(wav, "wav"));
}

/// Where pages of Ogg begin.
std::vector<std::size_t> ogg_pages(const std::string& bytes) {
  std::vector<std::size_t> pages;
  for (std::size_t at = bytes.find("OggS"); at != std::string::npos; at = bytes.find("OggS", at + 4)) pages.push_back(at);
  return pages;
}

TEST_F(DamagedSound, OggEndsWithItsLastPage) {
  for (const int subtype : {SF_FORMAT_VORBIS, SF_FORMAT_OPUS}) {
    const std::string ogg = encoded(SF_FORMAT_OGG | subtype, "ogg", 100000);
    const std::vector<std::size_t> pages = ogg_pages(ogg);
    ASSERT_GE(pages.size(), 4u);
    for (std::size_t page = 1; page < pages.size(); ++page)
      EXPECT_THAT(refusal(ogg.substr(0, pages[page]), "ogg"), HasSubstr("is truncated")) << page;
    const std::size_t third = pages[2], fourth = pages[3];
    EXPECT_THAT(refusal(ogg.substr(0, third) + ogg.substr(fourth), "ogg"), HasSubstr("a page is missing"));
    EXPECT_THAT(refusal(ogg + ogg, "ogg"), HasSubstr("several sounds in sequence"));
    EXPECT_EQ(read(ogg + "TAG" + std::string(125, ' '), "ogg"), read(ogg, "ogg"));
  }
}

// The decoder estimates the length of an MP3 without a frame that states it, and reads no further.
TEST_F(DamagedSound, Mp3IsReadToItsLastFrame) {
  const std::string mp3 = encoded(SF_FORMAT_MPEG | SF_FORMAT_MPEG_LAYER_III, "mp3", 60000);
  if (mp3.empty()) GTEST_SKIP() << "this libsndfile writes no MP3";
  const std::vector<float> whole = read(mp3, "mp3");
  EXPECT_EQ(whole.size(), 60000u);
  EXPECT_EQ(read(mp3 + "TAG" + std::string(125, ' '), "mp3"), whole);
  const std::size_t second = mp3.find(mp3.substr(0, 2), mp3.find("Xing"));
  ASSERT_NE(second, std::string::npos);
  const std::string stream = mp3.substr(second);
  if (const std::string message = refusal(stream, "mp3"); message.empty()) {
    EXPECT_GE(read(stream, "mp3").size(), 59000u);
  } else {
    EXPECT_THAT(message, HasSubstr("samples can be read"));
  }
  EXPECT_THAT(refusal(mp3 + mp3, "mp3"), HasSubstr("frames of MPEG audio"));
}

TEST_F(DamagedSound, TheGivenFilesAreRefused) {
  SKIP_WITHOUT_DATA("field");
  for (const char* file : {"sound_cut_flac/a.flac", "sound_cut_wav/cut.wav"}) {
    const std::string path = (data_folder() / "field" / file).string();
    const auto message = message_of<InputError>([&] { load_sound(path, 16000); });
    EXPECT_THAT(message, HasSubstr(path));
  }
}

}  // namespace
}  // namespace earshot
