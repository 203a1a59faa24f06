// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/programs/dataset_cli.h"

namespace earshot {

/// What a corpus of signals says of itself that its own sounds, texts and responses do not, by code that shares nothing with the writer but
/// the file formats.
struct CorpusDifferences {
  std::size_t utterances = 0, talkers = 0, later_talkers = 0, longer_talkers = 0, lowered = 0;  ///< that were looked at
  std::size_t texts = 0, lengths = 0, levels = 0, ratios = 0, times = 0, sums = 0;              ///< that differ
};

class RecomputedCorpus : public DatasetCli {
 protected:
  explicit RecomputedCorpus(const std::string& name) : DatasetCli(name) {}

  /// Speech files of 3 to 150 ms in folders of twenty as those of LibriSpeech, each with a text of its own but for every seventh, and three
  /// noises.
  void write_speech(std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) {
      const std::string chapter = fmt::format("{}-{}", i / 100, i / 20), id = fmt::format("{}-{:04}", chapter, i % 20);
      const std::string name = fmt::format("{}/{}/{}.wav", i / 100, i / 20, id);
      const std::size_t samples = 24 + (i * 7919) % 1177;
      speak(name, i, samples);
      clips_[name] = noise_of(i, samples);
      if (i % 7 == 3) continue;
      texts_[name] = fmt::format("WORDS {} OF \xC3\x89T\xC3\x89 {}", i, chapter);
      lists_[fmt::format("{}/{}/{}.trans.txt", i / 100, i / 20, chapter)] += fmt::format("{} {}\r\n", id, texts_[name]);
    }
    for (const auto& [file, text] : lists_) write_text(path("speech/" + file), text);
    std::filesystem::create_directories(path("noise"));
    for (std::size_t i = 0; i < 3; ++i) write_wav(path(fmt::format("noise/{}.wav", i)), noise_of(900000 + i, 3000 + i), 1, kRateHz);
  }

  /// Of the folder `out`, made of write_speech with --stems and without --cut.
  [[nodiscard]] CorpusDifferences compare(const std::string& out) {
    std::map<std::string, nlohmann::json> responses;
    for (const auto& line : lines("corpus/manifest.jsonl")) responses[line["id"]] = line;
    std::map<std::string, std::vector<float>> filters;
    const auto recordings = lines(out + "/recordings.jsonl"), segments = lines(out + "/supervisions.jsonl");
    CorpusDifferences found;
    std::size_t segment = 0;
    for (const auto& line : lines(out + "/manifest.jsonl")) {
      const std::vector<float> whole = sound(out, line["file"]);
      const auto& recording = recordings.at(found.utterances++);
      found.lengths += line["num_samples"] != whole.size() || recording["num_samples"] != whole.size() || recording["id"] != line["id"] ||
                       std::abs(recording["duration"].get<double>() * kRateHz - static_cast<double>(whole.size())) > 1e-6;
      std::vector<double> speech(whole.size(), 0), sum(whole.size(), 0);
      std::size_t longest = 0;
      double first_energy = 0, loudest = 0;
      for (std::size_t t = 0; t < line["talkers"].size(); ++t, ++segment) {
        const auto& talker = line["talkers"][t];
        const std::string name = talker["speech"];
        const std::vector<float>& clip = clips_.at(name);
        const std::string& id = talker["response"].get_ref<const std::string&>();
        if (!filters.contains(id)) filters[id] = sound("corpus", responses.at(id)["file"]);
        const std::vector<float>& filter = filters.at(id);
        const std::vector<float> stem = sound(out, talker["file"]);
        const auto start = talker["start_sample"].get<std::size_t>();
        loudest = std::max(loudest, peak_of(stem));
        ++found.talkers;
        found.later_talkers += start > 0;
        found.longer_talkers += t > 0 && clip.size() > line["talkers"][0]["num_samples"].get<std::size_t>();
        longest = std::max(longest, start + clip.size() + filter.size() - 1);
        found.lengths += talker["num_samples"] != clip.size() || stem.size() != whole.size();
        found.texts += has_other_text(talker, name) || has_other_text(segments.at(segment), name);
        found.times += is_at_another_time(stem, clip, filter, start, talker["gain"].get<double>());
        // From the direct sound on, for as long as the clip.
        const double delay = std::round(kRateHz * responses.at(id)["direct_delay_s"].get<double>());
        found.times += std::abs(segments[segment]["start"].get<double>() * kRateHz - (static_cast<double>(start) + delay)) > 1e-6 ||
                       std::abs(segments[segment]["duration"].get<double>() * kRateHz - static_cast<double>(clip.size())) > 1e-6 ||
                       segments[segment]["recording_id"] != line["id"];
        // Drawn in hundredths of a decibel within the range that was asked.
        const double ratio_db = t == 0 ? 0 : 10 * std::log10(energy(stem) / first_energy);
        if (t == 0) first_energy = energy(stem);
        found.ratios += ratio_db < -5.005 || ratio_db > 5.005 || std::abs(ratio_db - 0.01 * std::round(100 * ratio_db)) > 1e-4;
        for (std::size_t n = 0; n < std::min(stem.size(), whole.size()); ++n) speech[n] += static_cast<double>(stem[n]);
      }
      found.lengths += longest != whole.size();
      const std::vector<float> noise = sound(out, line["noise"]["file"]);
      double speech_energy = 0, apart = 0;
      for (std::size_t n = 0; n < whole.size(); ++n) {
        speech_energy += speech[n] * speech[n];
        apart = std::max(apart, std::abs(speech[n] + static_cast<double>(noise.at(n)) - static_cast<double>(whole[n])));
      }
      found.sums += apart > 1e-6;
      // Both labels are decimals of two digits; a lowered level has six digits.
      found.ratios += std::abs(10 * std::log10(speech_energy / energy(noise)) - line["noise"]["snr_db"].get<double>()) > 1e-3;
      const double level_db = 10 * std::log10(energy(whole) / static_cast<double>(whole.size()));
      found.levels += std::abs(level_db - line["level_dbfs"].get<double>()) > 1e-3;
      // The loudest sample of all files is at 0.999 where the level was lowered, and below it elsewhere.
      loudest = std::max({loudest, peak_of(whole), peak_of(noise)});
      found.levels += line["lowered"].get<bool>() ? std::abs(loudest - 0.999) > 1e-5 : loudest > 0.99901;
      found.lowered += line["lowered"].get<bool>();
    }
    found.lengths += segment != segments.size() || recordings.size() != found.utterances;
    return found;
  }

  static void expect_none(const CorpusDifferences& found) {
    EXPECT_EQ(found.texts, 0u);
    EXPECT_EQ(found.lengths, 0u);
    EXPECT_EQ(found.levels, 0u);
    EXPECT_EQ(found.ratios, 0u);
    EXPECT_EQ(found.times, 0u);
    EXPECT_EQ(found.sums, 0u);
  }

 private:
  [[nodiscard]] bool has_other_text(const nlohmann::json& labels, const std::string& name) const {
    const auto found = texts_.find(name);
    if (found == texts_.end()) return labels.contains("text");
    return !labels.contains("text") || labels["text"] != found->second;
  }

  static double peak_of(const std::vector<float>& samples) {
    double peak = 0;
    for (const float sample : samples) peak = std::max(peak, std::abs(static_cast<double>(sample)));
    return peak;
  }

  /// Whether the stem is anything but the clip through the response from this sample on: by the sum that defines it, at every sample.  A
  /// shift by one sample would change noise by as much as it is.  1e-4 of the peak: float transforms, and six digits of the gain.
  static bool is_at_another_time(const std::vector<float>& stem, const std::vector<float>& clip, const std::vector<float>& filter,
                                 std::size_t start, double gain) {
    std::vector<double> expected(stem.size(), 0);
    double peak = 0, apart = 0;
    for (std::size_t i = 0; i < clip.size(); ++i)
      for (std::size_t k = 0; k < filter.size() && start + i + k < stem.size(); ++k)
        expected[start + i + k] += static_cast<double>(clip[i]) * static_cast<double>(filter[k]);
    for (std::size_t n = 0; n < stem.size(); ++n) {
      peak = std::max(peak, std::abs(gain * expected[n]));
      apart = std::max(apart, std::abs(gain * expected[n] - static_cast<double>(stem[n])));
    }
    return !(apart < 1e-4 * peak);
  }

  std::map<std::string, std::vector<float>> clips_;
  std::map<std::string, std::string> texts_, lists_;
};

}  // namespace earshot
