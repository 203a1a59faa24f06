// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <chrono>
#include <mutex>
#include <set>
#include <stdexcept>
#include <thread>

#include "datasets/corpus_parts.h"
#include "sim/base/files.h"
#include "tests/support/envs/env_cases.h"
#include "tests/support/wait_until.h"

namespace earshot {
namespace {

constexpr int kParts = 5, kPieces = 3;

/// Parts of three pieces with a file and a line each, two parts in a folder.
class CorpusPartsTest : public testing::Test {
 protected:
  CorpusPartsReport complete(const TestFolder& out, int threads, const MakeCorpusPiece& make, int pieces = kPieces) {
    const CorpusFolder folder(out.path(), kParts, 2, 16000, 0);
    folder.begin("{}\n");
    CorpusParts parts;
    parts.pieces = pieces;
    parts.items = [pieces](std::size_t) { return static_cast<std::uint64_t>(pieces); };
    parts.begin = [this](std::size_t part) { ++begun_[part]; };
    parts.end = [this](std::size_t part) { ++ended_[part]; };
    parts.make_worker = [this, &make] {
      ++workers_;
      return make;
    };
    return complete_corpus(folder, {.out = out.path(), .threads = threads, .shard = {}, .progress = {}}, parts);
  }
  static void write_piece(CorpusPiece piece, CorpusPieceWriter& writer, const std::function<void()>& count_item) {
    const std::string name = fmt::format("{:06}_{}.txt", piece.part, piece.number);
    writer.add_line(fmt::format("{{\"file\":\"{}\"}}", writer.write(name, name)));
    count_item();
  }

  std::array<std::atomic<int>, kParts> begun_{}, ended_{};
  std::atomic<int> workers_ = 0;
};

TEST_F(CorpusPartsTest, LinesAreInTheOrderOfPartsAndPieces) {
  const TestFolder out("corpus_parts_order");
  // The first piece of each part is the last to end.
  const CorpusPartsReport report = complete(out, 4, [](CorpusPiece piece, CorpusPieceWriter& writer, const std::function<void()>& count) {
    if (piece.number == 0) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    write_piece(piece, writer, count);
  });
  EXPECT_EQ(report.parts, 5u);
  EXPECT_EQ(report.items, 15u);
  EXPECT_EQ(report.folders_missing, 0u);
  std::string expected;
  for (int part = 0; part < kParts; ++part)
    for (int piece = 0; piece < kPieces; ++piece) expected += fmt::format("{{\"file\":\"{:05}/{:06}_{}.txt\"}}\n", part / 2, part, piece);
  EXPECT_EQ(read_file(out.path() / "manifest.jsonl"), expected);
  for (int part = 0; part < kParts; ++part) {
    EXPECT_EQ(begun_[part], 1) << part;
    EXPECT_EQ(ended_[part], 1) << part;
  }
  EXPECT_LE(workers_, 4);
  EXPECT_EQ(complete(out, 4, write_piece).parts, 0u);  // nothing is missing
}

TEST_F(CorpusPartsTest, ThreadsHelpWithThePiecesOfOthers) {
  const TestFolder out("corpus_parts_help");
  std::mutex mutex;
  std::set<std::thread::id> threads;
  // Pieces wait for one another here: one thread alone would never come to the second.
  const CorpusFolder folder(out.path(), 1, 1, 16000, 0);
  folder.begin("{}\n");
  CorpusParts parts;
  parts.pieces = kPieces;
  parts.items = [](std::size_t) { return std::uint64_t{kPieces}; };
  std::atomic<int> inside = 0;
  parts.make_worker = [&] {
    return [&](CorpusPiece piece, CorpusPieceWriter& writer, const std::function<void()>& count_item) {
      ++inside;
      EXPECT_TRUE(wait_until([&] { return inside >= kPieces; }, 60));  // all are at work
      {
        const std::lock_guard lock(mutex);
        threads.insert(std::this_thread::get_id());
      }
      write_piece(piece, writer, count_item);
    };
  };
  complete_corpus(folder, {.out = out.path(), .threads = kPieces, .shard = {}, .progress = {}}, parts);
  EXPECT_EQ(threads.size(), 3u);
}

TEST_F(CorpusPartsTest, AFailureEndsTheOthersAtTheirNextItemAndKeepsWhatIsFinished) {
  const TestFolder out("corpus_parts_failure");
  const auto make = [&](CorpusPiece piece, CorpusPieceWriter& writer, const std::function<void()>& count_item) {
    if (piece.part == 2 && piece.number == 0) throw std::runtime_error("disk full");
    if (piece.part > 2 || (piece.part == 2 && piece.number > 0))
      for (;;) {  // ends by count_item alone
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        count_item();
      }
    write_piece(piece, writer, count_item);
  };
  EXPECT_THAT([&] { complete(out, 2, make); }, testing::ThrowsMessage<std::runtime_error>(testing::HasSubstr("disk full")));
  EXPECT_EQ(ended_[2], 0);
  EXPECT_FALSE(std::filesystem::exists(out.path() / "manifest.jsonl"));
  const CorpusPartsReport report = complete(out, 2, write_piece);
  EXPECT_LE(report.parts, 4u);
  EXPECT_EQ(report.folders_missing, 0u);
}

}  // namespace
}  // namespace earshot
