// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <thread>
#include <vector>

#include "compat/rlr_audio_propagation.h"

namespace earshot {
namespace {

RLRA_ContextConfiguration quick_configuration() {
  RLRA_ContextConfiguration configuration;
  EXPECT_EQ(RLRA_ContextConfigurationDefault(&configuration), RLRA_Success);
  configuration.indirectRayCount = 64;
  configuration.sampleRate = 8000.f;
  configuration.maxIRLength = 0.15f;
  return configuration;
}

constexpr RLRA_ChannelLayout kMono{1, RLRA_Layout_Mono}, kBinaural{2, RLRA_Layout_Binaural};

/// A room with a source and a listener that goes through it; all samples heard.
std::vector<float> heard_in_room(float width, const RLRA_ChannelLayout& layout) {
  const RLRA_ContextConfiguration configuration = quick_configuration();
  RLRA_Context context = nullptr;
  std::vector<float> heard;
  if (RLRA_CreateContext(&context, &configuration) != RLRA_Success) return heard;
  const std::array<float, 3> low{0, 0, 0}, high{width, 3, 4}, source{1, 1, 1};
  RLRA_AddObject(context);
  RLRA_SetObjectBox(context, 0, low.data(), high.data(), nullptr);
  RLRA_AddSource(context);
  RLRA_SetSourcePosition(context, 0, source.data());
  RLRA_AddListener(context, &layout);
  for (int step = 0; step < 3; ++step) {
    const std::array<float, 3> place{2.f + 0.2f * static_cast<float>(step), 1.5f, 2.f};
    RLRA_SetListenerPosition(context, 0, place.data());
    EXPECT_EQ(RLRA_Simulate(context), RLRA_Success);
    for (std::size_t channel = 0; channel < layout.channelCount; ++channel) {
      const float* samples = RLRA_GetIRChannel(context, 0, 0, channel);
      heard.insert(heard.end(), samples, samples + RLRA_GetIRSampleCount(context, 0, 0));
    }
  }
  EXPECT_EQ(RLRA_DestroyContext(context), RLRA_Success);
  return heard;
}

// Two threads in each of three rooms.  The tables of a head are four times the work of all else, and race if those of two contexts do.
TEST(CompatThreads, EachHasTheBitsThatOneThreadAloneGets) {
  constexpr std::size_t num_rooms = 3, num_threads = 2 * num_rooms;
  const auto hear = [](std::size_t room) { return heard_in_room(5.f + 0.25f * static_cast<float>(room), room == 0 ? kBinaural : kMono); };
  std::array<std::vector<float>, num_rooms> alone;
  for (std::size_t room = 0; room < num_rooms; ++room) alone[room] = hear(room);
  std::array<std::vector<float>, num_threads> together;
  {
    std::vector<std::jthread> threads;
    for (std::size_t i = 0; i < num_threads; ++i) threads.emplace_back([&, i] { together[i] = hear(i / 2); });
  }
  for (std::size_t i = 0; i < num_threads; ++i) {
    EXPECT_GT(together[i].size(), 1000u);
    EXPECT_EQ(alone[i / 2], together[i]) << i;
  }
  EXPECT_NE(alone[1], alone[2]);
}

TEST(CompatThreads, CallsForOneContextWaitForEachOtherAndEndAfterItsEnd) {
  const RLRA_ContextConfiguration configuration = quick_configuration();
  RLRA_Context context = nullptr;
  ASSERT_EQ(RLRA_CreateContext(&context, &configuration), RLRA_Success);
  std::atomic<int> num_other_codes{0};
  {
    std::vector<std::jthread> threads;
    for (int thread = 0; thread < 4; ++thread)
      threads.emplace_back([&, thread] {
        const std::array<float, 3> place{1.f, 2.f, static_cast<float>(thread)};
        for (int i = 0; i < 40; ++i) {
          if (i == 30 && thread == 0) RLRA_DestroyContext(context);
          for (const RLRA_Error code :
               {RLRA_AddSource(context), RLRA_SetSourcePosition(context, 0, place.data()), RLRA_AddListener(context, &kMono),
                i % 15 == 0 ? RLRA_Simulate(context) : RLRA_Success, RLRA_ClearListeners(context), RLRA_ClearSources(context)})
            if (code != RLRA_Success && code != RLRA_Uninitialized && code != RLRA_InvalidParameter) ++num_other_codes;
        }
      });
  }
  EXPECT_EQ(num_other_codes, 0);
  EXPECT_EQ(RLRA_Simulate(context), RLRA_Uninitialized);
}

}  // namespace
}  // namespace earshot
