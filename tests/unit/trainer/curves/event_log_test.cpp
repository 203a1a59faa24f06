// SPDX-License-Identifier: Apache-2.0
#include "trainer/curves/event_log.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstring>
#include <fstream>
#include <functional>
#include <map>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "tests/support/workers/worker_processes.h"

namespace earshot {
namespace {

const std::vector<std::pair<std::string, double>> kValues{{"policy/loss", 0.125}, {"episodes/success", 0.1}};

void write_points(const std::filesystem::path& folder, std::uint64_t first, std::uint64_t last, std::uint64_t resumed) {
  EventLog log(folder, resumed);
  for (std::uint64_t update = first; update <= last; ++update) log.write(update, 100 * update, 0.5 * static_cast<double>(update), kValues);
}

void append(const std::filesystem::path& file, const std::string& text) { write_file_atomically(file, read_file(file) + text); }

TEST(EventLog, PointsComeBack) {
  const PrivateTestFolder folder;
  write_points(folder.path() / "run", 1, 3, 0);
  const auto points = read_event_log(folder.path() / "run/events.jsonl");
  ASSERT_EQ(points.size(), 3u);
  EXPECT_EQ(points[1].update, 2u);
  EXPECT_EQ(points[1].env_steps, 200u);
  EXPECT_EQ(points[1].wall_s, 1.0);
  EXPECT_EQ(points[1].values, kValues);  // in order, and a double survives the text bit for bit
}

TEST(EventLog, LinesArePlainJson) {
  const PrivateTestFolder folder;
  EventLog(folder.path()).write(1, 2, 3.5, {{"a", 0.5}, {"gone", NAN}});
  EXPECT_EQ(read_file(folder.path() / "events.jsonl"),
            "{\"update\":1,\"env_steps\":2,\"wall_s\":3.5,\"values\":{\"a\":0.5,\"gone\":null}}\n");
  EXPECT_TRUE(std::isnan(read_event_log(folder.path() / "events.jsonl")[0].values[1].second));
}

TEST(EventLog, TornLastLineIsIgnored) {
  const PrivateTestFolder folder;
  const auto file = folder.path() / "events.jsonl";
  write_points(folder.path(), 1, 3, 0);
  const std::string whole = read_file(file);
  const std::size_t last_line = whole.rfind('\n', whole.size() - 2) + 1;
  for (std::size_t length = last_line; length < whole.size(); ++length) {
    std::ofstream(file, std::ios::binary) << whole.substr(0, length);
    ASSERT_EQ(read_event_log(file).size(), 2u) << length;
  }
  append(file, std::string(30, '\0') + "\n");  // what a crashed machine may leave
  EXPECT_EQ(read_event_log(file).size(), 2u);
}

TEST(EventLog, ResumeCutsOffTheFutureAndTornLines) {
  const PrivateTestFolder folder;
  const auto file = folder.path() / "events.jsonl";
  write_points(folder.path(), 1, 5, 0);
  append(file, "{\"update\":6,\"env_st");
  write_points(folder.path(), 4, 4, 3);  // goes on after update 3
  std::vector<std::uint64_t> updates;
  for (const auto& point : read_event_log(file)) updates.push_back(point.update);
  EXPECT_EQ(updates, (std::vector<std::uint64_t>{1, 2, 3, 4}));
}

TEST(EventLog, ResumeCutsOffEvaluationsThatTheStateDoesNotHave) {
  const std::vector<std::pair<std::string, double>> evaluation{{"held_out/argmax_success", 0.5}};
  for (std::uint64_t evaluated : {0, 2, 4, 9}) {
    const PrivateTestFolder folder;
    {
      EventLog log(folder.path());
      for (std::uint64_t update = 1; update <= 6; ++update) {
        log.write(update, 10 * update, 1, kValues);
        if (update % 2 == 0) log.write(update, 10 * update, 1, evaluation);
      }
    }
    EventLog resumed(folder.path(), 4, evaluated);  // a checkpoint of update 4, before or behind its evaluation
    std::vector<std::uint64_t> updates, evaluations;
    for (const auto& point : read_event_log(folder.path() / "events.jsonl"))
      (is_of_held_out(point) ? evaluations : updates).push_back(point.update);
    EXPECT_EQ(updates, (std::vector<std::uint64_t>{1, 2, 3, 4}));
    std::vector<std::uint64_t> right;
    for (std::uint64_t update = 2; update <= std::min<std::uint64_t>(4, evaluated); update += 2) right.push_back(update);
    EXPECT_EQ(evaluations, right) << evaluated;
  }
}

TEST(EventLog, AnotherFileIsAnInputError) {
  const PrivateTestFolder folder;
  const auto file = folder.path() / "events.jsonl";
  write_points(folder.path(), 1, 2, 0);
  const std::string lines = read_file(file);
  for (const char* bad : {"hello\n", "{\"update\":-1}\n", "[1]\n", "{\"update\":\"1\",\"env_steps\":1,\"wall_s\":1,\"values\":{}}\n"}) {
    write_file_atomically(file, lines + bad + lines);
    try {
      read_event_log(file);
      FAIL() << bad;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("events.jsonl:3"), std::string::npos) << error.what();
    }
    EXPECT_THROW(EventLog(folder.path(), 1), InputError);
    EXPECT_EQ(read_file(file), lines + bad + lines);  // and is left alone
  }
  EXPECT_THROW(read_event_log(folder.path() / "none.jsonl"), InputError);
}

/// Where no file may have more than 1000 bytes: does `write_much` end with an error that names `file`?
bool fails_on_a_full_disk(const std::string& file, const std::function<void()>& write_much) {
  const pid_t pid = WorkerProcesses::start(0, [&](int) {
    ::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{1000, 1000};
    ::setrlimit(RLIMIT_FSIZE, &limit);
    try {
      write_much();
    } catch (const RunError& error) {
      return std::string(error.what()).find(file) != std::string::npos;
    }
    return false;
  });
  int status = -1;
  ::waitpid(pid, &status, 0);
  return status == 0;
}

TEST(EventLog, FullDiskLeavesWholeLines) {
  const PrivateTestFolder folder;
  EXPECT_TRUE(fails_on_a_full_disk("events", [&] { write_points(folder.path(), 1, 99, 0); }));
  const std::string text = read_file(folder.path() / "events.jsonl");
  EXPECT_EQ(text.back(), '\n');
  EXPECT_GE(read_event_log(folder.path() / "events.jsonl").size(), 3u);
}

// RFC 3720, appendix B.4, and the check value of the CRC catalogue ("123456789").
TEST(TensorBoard, ChecksumsMatchPublishedVectors) {
  EXPECT_EQ(crc32c("123456789"), 0xE3069283u);
  EXPECT_EQ(crc32c(std::string(32, '\0')), 0x8A9136AAu);
  EXPECT_EQ(crc32c(std::string(32, '\xFF')), 0x62A8AB43u);
  std::string rising, falling;
  for (int i = 0; i < 32; ++i) rising += static_cast<char>(i), falling += static_cast<char>(31 - i);
  EXPECT_EQ(crc32c(rising), 0x46DD794Eu);
  EXPECT_EQ(crc32c(falling), 0x113FDB5Cu);
  // ((crc >> 15) | (crc << 17)) + 0xa282ead8 of 0xE3069283, by hand: 0x2507C60D + 0xA282EAD8.
  EXPECT_EQ(masked_crc32c("123456789"), 0xC78AB0E5u);
}

/// A reader of event files that shares nothing with the writer but the checksum, which the vectors above pin.
struct DecodedEvent {
  double wall_time = 0;
  std::uint64_t step = 0;
  std::string file_version;
  bool session_start = false;
  std::map<std::string, float> scalars;
};

class Decoder {
 public:
  explicit Decoder(std::string bytes) : bytes_(std::move(bytes)) {}
  [[nodiscard]] bool done() const { return at_ == bytes_.size(); }
  std::string take(std::size_t count) {
    if (count > bytes_.size() - at_) throw std::runtime_error("past the end");
    at_ += count;
    return bytes_.substr(at_ - count, count);
  }
  template <class T>
  T fixed() {
    T value;
    std::memcpy(&value, take(sizeof(T)).data(), sizeof(T));
    return value;
  }
  std::uint64_t varint() {
    std::uint64_t value = 0;
    for (int shift = 0;; shift += 7) {
      const auto byte = static_cast<unsigned char>(take(1)[0]);
      value |= static_cast<std::uint64_t>(byte & 0x7F) << shift;
      if (byte < 0x80) return value;
    }
  }

 private:
  std::string bytes_;
  std::size_t at_ = 0;
};

DecodedEvent decode_event(const std::string& bytes) {
  DecodedEvent event;
  for (Decoder fields(bytes); !fields.done();) {
    switch (fields.varint()) {
      case 0x09:
        event.wall_time = fields.fixed<double>();
        break;  // field 1, 64 bit
      case 0x10:
        event.step = fields.varint();
        break;  // field 2, varint
      case 0x1A:
        event.file_version = fields.take(fields.varint());
        break;  // field 3, bytes
      case 0x3A:
        event.session_start = fields.take(fields.varint()) == "\x08\x01";
        break;
      case 0x2A: {  // field 5: summary
        for (Decoder summary(fields.take(fields.varint())); !summary.done();) {
          EXPECT_EQ(summary.varint(), 0x0Au);  // value
          Decoder value(summary.take(summary.varint()));
          EXPECT_EQ(value.varint(), 0x0Au);  // tag
          const std::string tag = value.take(value.varint());
          EXPECT_EQ(value.varint(), 0x15u);  // simple_value, 32 bit
          event.scalars[tag] = value.fixed<float>();
          EXPECT_TRUE(value.done());
        }
        break;
      }
      default:
        ADD_FAILURE() << "unknown field";
        return event;
    }
  }
  return event;
}

std::vector<DecodedEvent> decode_file(const std::filesystem::path& path) {
  std::vector<DecodedEvent> events;
  for (Decoder records(read_file(path)); !records.done();) {
    const std::string length = records.take(8);
    EXPECT_EQ(records.fixed<std::uint32_t>(), masked_crc32c(length));
    std::uint64_t size = 0;
    std::memcpy(&size, length.data(), 8);
    const std::string event = records.take(size);
    EXPECT_EQ(records.fixed<std::uint32_t>(), masked_crc32c(event));
    events.push_back(decode_event(event));
  }
  return events;
}

TEST(TensorBoard, FullDiskLeavesWholeRecords) {
  const PrivateTestFolder folder;
  EXPECT_TRUE(fails_on_a_full_disk("events.out", [&] {
    TensorBoardWriter writer(folder.path());
    for (std::int64_t step = 1; step < 100; ++step) writer.write(step, kValues);
  }));
  const auto file = std::filesystem::directory_iterator(folder.path())->path();
  EXPECT_GT(std::filesystem::file_size(file), 800u);
  EXPECT_GE(decode_file(file).size(), 5u);  // throws at a torn record
}

TEST(TensorBoard, FileDecodes) {
  const PrivateTestFolder folder;
  TensorBoardWriter writer(folder.path(), 1234);
  writer.write(300, kValues);
  const std::vector<std::pair<std::string, double>> odd{{"nan", NAN}, {std::string(300, 'n'), -2.5}};
  writer.write(5000000000, odd);
  EXPECT_TRUE(writer.path().filename().string().starts_with("events.out.tfevents."));
  const auto events = decode_file(writer.path());
  ASSERT_EQ(events.size(), 4u);
  EXPECT_EQ(events[0].file_version, "brain.Event:2");
  EXPECT_GT(events[0].wall_time, 1.6e9);
  EXPECT_TRUE(events[1].session_start);
  EXPECT_EQ(events[1].step, 1234u);
  EXPECT_EQ(events[2].step, 300u);
  EXPECT_EQ(events[2].scalars, (std::map<std::string, float>{{"policy/loss", 0.125f}, {"episodes/success", 0.1f}}));
  EXPECT_EQ(events[3].step, 5000000000u);
  EXPECT_EQ(events[3].scalars, (std::map<std::string, float>{{std::string(300, 'n'), -2.5f}}));
}

TEST(TensorBoard, TwoStartsWithinASecondGiveTwoFilesAndTheLogWritesThem) {
  const PrivateTestFolder folder;
  write_points(folder.path(), 1, 5, 0);
  write_points(folder.path(), 4, 4, 3);
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder.path()))
    if (entry.path().filename() != "events.jsonl") files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  ASSERT_EQ(files.size(), 2u);
  EXPECT_EQ(decode_file(files[0]).back().step, 500u);
  const auto resumed = decode_file(files[1]);
  EXPECT_TRUE(resumed[1].session_start);
  EXPECT_EQ(resumed[1].step, 301u);  // points up to step 300 stand
  EXPECT_EQ(resumed[2].step, 400u);
}

}  // namespace
}  // namespace earshot
