// SPDX-License-Identifier: Apache-2.0
// Corpora on disk.
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <tuple>

#include "earshot/dataset.h"
#include "python/src/interruptible.h"

namespace earshot::python {
namespace {

using Range = std::optional<std::array<float, 2>>;
/// Signals of the call, signals in all, folders missing, bad files left out.
using Written = std::tuple<std::uint64_t, std::uint64_t, std::uint64_t, std::uint64_t>;

Written write_signals(const std::string& corpus, const std::string& speech, const std::string& out, const std::string& noise,
                      std::uint64_t seed, std::uint64_t count, std::array<int, 2> talkers, std::array<bool, 3> parts, bool skip_bad,
                      Range rt60_s, Range drr_db, int threads, const std::string& shard) {
  const ConvolveOptions options{.corpus = corpus,
                                .speech = speech,
                                .noise = noise,
                                .seed = seed,
                                .count = count,
                                .min_talkers = talkers[0],
                                .max_talkers = talkers[1],
                                .early = parts[0],
                                .dry = parts[1],
                                .stems = parts[2],
                                .skip_bad = skip_bad,
                                .rt60_s = rt60_s,
                                .drr_db = drr_db};
  return interruptible([=](const std::stop_token& stop) {
    const auto stop_here = [stop](std::uint64_t, std::uint64_t) {
      if (stop.stop_requested()) throw RunError("convolve", "was interrupted; the same call completes the corpus");
    };
    const CorpusReport report = write_convolved_corpus(options, {.out = out, .threads = threads, .shard = shard, .progress = stop_here});
    return Written{report.written, report.total, report.folders_missing, report.left_out};
  });
}

}  // namespace

void bind_corpora(nb::module_& m) { m.def("write_signals", &write_signals); }

}  // namespace earshot::python
