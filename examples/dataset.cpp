// SPDX-License-Identifier: Apache-2.0
// dataset FOLDER
// Writes a small corpus of responses with labels.  Run again, it finds the corpus complete.
#include <earshot/dataset.h>

#include <cstdio>

int main(int argc, char** argv) try {
  if (argc != 2) {
    std::fputs("usage: dataset FOLDER\n", stderr);
    return 2;
  }
  const auto config = earshot::Config::from_text(
      "shoeboxes: {count: 2}\n"
      "sources_per_room: 1\n"
      "listeners_per_source: 3\n"
      "acoustics: {preset: fast, rir_length_s: 0.3}\n");
  const earshot::CorpusReport report = earshot::write_rir_corpus(config, {.out = argv[1], .threads = 0});
  std::printf("%s: %llu responses written, %llu in the corpus, %zu folders missing\n", argv[1],
              static_cast<unsigned long long>(report.written), static_cast<unsigned long long>(report.total), report.folders_missing);
} catch (const std::exception& error) {
  std::fprintf(stderr, "dataset: %s\n", error.what());
  return 1;
}
