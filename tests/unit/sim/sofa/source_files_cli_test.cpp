// SPDX-License-Identifier: Apache-2.0
// Directivities of sources as SOFA files and CLF text have them, by `earshot rir --source-pattern`: the direct sound in a free field.
#if __has_include(<hdf5.h>)

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>

#include "sim/base/random.h"
#include "tests/support/files/made_clf.h"
#include "tests/support/files/made_source.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

constexpr double kPi = std::numbers::pi;

double drawn_value(std::uint32_t stream, std::uint32_t index, double low, double high) {
  return low + (high - low) * static_cast<double>(RandomStream(stream, Purpose::test).uniform2(index)[0]);
}
glm::dvec3 drawn_direction(std::uint32_t stream, std::uint32_t index) {
  const double height = drawn_value(stream, 2 * index, -1, 1), angle = drawn_value(stream, 2 * index + 1, 0, 2 * kPi);
  return {std::sqrt(1 - height * height) * std::cos(angle), std::sqrt(1 - height * height) * std::sin(angle), height};
}
MadePose drawn_pose(std::uint32_t stream, std::uint32_t index) {
  MadePose pose{.place = 3.0 * drawn_direction(stream, 3 * index), .front = drawn_direction(stream, 3 * index + 1)};
  const glm::dvec3 above = drawn_direction(stream, 3 * index + 2);
  pose.up = glm::normalize(above - glm::dot(above, pose.front) * pose.front);
  return pose;
}

/// Far field of a piston of this radius on the end of a tube: that of one in a baffle, 2 J1(x) / x, times (1 + cos) / 2.
double piston(double cosine, double frequency_hz, double radius_m) {
  const double x = 2 * kPi * frequency_hz / 343.0 * radius_m * std::sqrt(std::max(0.0, 1 - cosine * cosine));
  return (x < 1e-6 ? 1.0 : 2 * std::cyl_bessel_j(1.0, x) / x) * 0.5 * (1 + cosine);
}

struct NamedPattern {
  const char* name;
  std::function<double(double cosine, double frequency_hz)> gain;
};
const std::array<NamedPattern, 4> kSources{{{"monopole", [](double, double) { return 1.0; }},
                                            {"dipole", [](double cosine, double) { return cosine; }},
                                            {"cardioid", [](double cosine, double) { return 0.5 * (1 + cosine); }},
                                            {"piston", [](double cosine, double hz) { return piston(cosine, hz, 0.06); }}}};

/// The octave around a centre as the engine has it.
struct Octave {
  double low_hz, high_hz;
};
Octave octave_at(double centre_hz) {
  const double exact = 1000 * std::pow(10, 0.3 * std::round(std::log2(centre_hz / 1000)));
  return {exact * std::pow(10, -0.15), exact * std::pow(10, 0.15)};
}
/// Root of the mean squared gain over the octave at a centre, by lines a third of an octave apart.
double octave_gain(const std::function<double(double, double)>& gain, double cosine, double centre_hz) {
  const Octave octave = octave_at(centre_hz);
  double power = 0;
  for (const int k : {-1, 0, 1}) {
    const double line = centre_hz * std::exp2(k / 3.0), half = std::exp2(1.0 / 6);
    const double low = k < 0 ? octave.low_hz : line / half, high = k > 0 ? octave.high_hz : line * half;
    power += (high - low) / (octave.high_hz - octave.low_hz) * std::pow(gain(cosine, line), 2);
  }
  return std::sqrt(power);
}

class SourceFiles : public Cli {
 protected:
  void SetUp() override {
    Cli::SetUp();
    if (!std::filesystem::exists(earshot_program())) GTEST_SKIP() << "built without the program";
  }
  /// towards: from the source, axes of SOFA in those of the source.
  [[nodiscard]] std::string command(const std::string& pattern, const std::vector<glm::dvec3>& towards, const std::string& out) const {
    std::string line =
        "rir shoebox:40x40x40@1 --preset fast --rate 32000 --channels mono --set early=off --set late=off --set air_absorption=off "
        "--source 20,20,20 --source-pattern " +
        pattern + " --out " + file(out);
    for (const glm::dvec3 direction : towards) {
      const glm::dvec3 place = glm::dvec3(20) + 5.0 * glm::dvec3(-direction.y, direction.z, -direction.x);
      line += fmt::format(" --listener {:.7f},{:.7f},{:.7f}", place.x, place.y, place.z);
    }
    return line;
  }
  using Spectrum = std::vector<std::complex<double>>;
  /// Spectra of the direct sound in several directions at these frequencies.
  [[nodiscard]] std::vector<Spectrum> hear(const std::string& pattern, const std::vector<glm::dvec3>& towards,
                                           const std::vector<double>& frequency_hz) const {
    const CliOutcome outcome = earshot(command(pattern, towards, "out.wav"));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    std::vector<Spectrum> spectra;
    for (std::size_t i = 0; i < towards.size(); ++i) {
      const std::vector<float> samples = read_wav(towards.size() == 1 ? "out.wav" : fmt::format("out.s0.l{}.wav", i));
      Spectrum& spectrum = spectra.emplace_back(frequency_hz.size());
      for (std::size_t f = 0; f < frequency_hz.size(); ++f)
        for (std::size_t n = 0; n < std::min<std::size_t>(samples.size(), 2000); ++n)
          spectrum[f] += static_cast<double>(samples[n]) * std::polar(1.0, -2 * kPi * frequency_hz[f] * static_cast<double>(n) / 32000.0);
    }
    return spectra;
  }
  std::string made(const MadeSource& source, const std::string& name = "source.sofa") const { return write(name, source.bytes()); }
};

const std::vector<double> kCentres = {125, 250, 500, 1000, 2000, 4000, 8000};

std::vector<double> third_octave_lines() {
  std::vector<double> lines;
  for (int k = -10; k <= 11; ++k) lines.push_back(1000 * std::exp2(k / 3.0));
  return lines;
}

MadeSource made_source(const NamedPattern& pattern) {
  MadeSource source;
  source.pattern = [gain = pattern.gain](glm::dvec3 direction, double frequency_hz) {
    // On the axis any spectrum and any phase: gains are relative to it.
    return std::polar(2.0 + std::sin(frequency_hz / 300), 0.7 + frequency_hz / 500) * gain(direction.x, frequency_hz);
  };
  source.frequency_hz = third_octave_lines();
  return source;
}

// Level of each octave against an omnidirectional source, where the gain is at least 0.1.  A grid of 5 degrees: 0.2 dB of
// what does not change with frequency, and 0.5 dB of the piston, whose octaves are heard with smooth transitions; coarser ones twice that.
TEST_F(SourceFiles, LevelsAreThoseOfTheClosedForm) {
  const std::vector<std::complex<double>> omni = hear("omni", {{1, 0, 0}}, kCentres)[0];
  for (std::uint32_t i = 0; i < 12; ++i) {
    const NamedPattern& pattern = kSources[i % 4];
    MadeSource source = made_source(pattern);
    const double radius = drawn_value(11, i, 1, 4);
    if (i < 4)
      source.add_grid(5, radius);
    else if (i < 8)
      source.add_spiral(1000, radius);
    else
      source.add_grid(5, radius, -65, 70);  // without the poles
    source.spherical = i % 3 != 0;
    if (i >= 2) source.source = drawn_pose(12, i);
    if (i % 2) source.listener = drawn_pose(13, i);
    for (std::uint32_t r = 0; r < source.receivers.size(); ++r) source.receivers[r] *= drawn_value(14, i * 10000 + r, 0.9, 1.1);
    const std::string name = made(source);
    std::vector<glm::dvec3> directions;
    for (std::uint32_t d = 0; d < 10; ++d) {
      const glm::dvec3 drawn = drawn_direction(15, 10 * i + d);
      directions.push_back(i < 8 ? drawn : glm::normalize(glm::dvec3(drawn.x, drawn.y, 0.5 * drawn.z)));
    }
    const std::vector<Spectrum> spectra = hear(name, directions, kCentres);
    for (std::size_t d = 0; d < directions.size(); ++d) {
      const Spectrum& heard = spectra[d];
      const glm::dvec3 towards = directions[d];
      const double tolerance_db = (i < 4 || i >= 8 ? 1 : 2) * (i % 4 == 3 ? 0.5 : 0.2);
      for (std::size_t b = 0; b < kCentres.size(); ++b) {
        const double gain = octave_gain(pattern.gain, towards.x, kCentres[b]);
        if (gain < 0.1) continue;
        EXPECT_NEAR(20 * std::log10(std::abs(heard[b] / omni[b])), 20 * std::log10(gain), tolerance_db)
            << i << ' ' << pattern.name << ' ' << kCentres[b] << " Hz, cosine " << towards.x;
      }
    }
  }
}

TEST_F(SourceFiles, TheBackOfADipoleIsTurned) {
  MadeSource source = made_source(kSources[1]);
  source.add_grid(10, 2);
  const std::string name = made(source);
  const std::vector<glm::dvec3> both{{1, 0, 0}, {-1, 0, 0}};
  const std::vector<Spectrum> omni = hear("omni", both, {1000}), heard = hear(name, both, {1000});
  EXPECT_NEAR((heard[0][0] / omni[0][0]).real(), 1, 0.02);
  EXPECT_NEAR((heard[1][0] / omni[1][0]).real(), -1, 0.02);
}

// Lines every 20 Hz become third octaves by their power, and these the octave by their width.  0.7 dB at gains over 0.1.
TEST_F(SourceFiles, DenseLinesCountByTheirPower) {
  MadeSource source = made_source(kSources[3]);
  source.frequency_hz.clear();
  for (double hz = 50; hz <= 12000; hz += 20) source.frequency_hz.push_back(hz);
  source.add_grid(10, 1.5);
  const std::string name = made(source);
  const std::vector<std::complex<double>> omni = hear("omni", {{1, 0, 0}}, kCentres)[0];
  std::vector<glm::dvec3> directions;
  for (const double angle : {30.0, 50.0, 80.0}) directions.emplace_back(std::cos(angle * kPi / 180), std::sin(angle * kPi / 180), 0);
  const std::vector<Spectrum> spectra = hear(name, directions, kCentres);
  for (std::size_t d = 0; d < directions.size(); ++d) {
    const glm::dvec3 towards = directions[d];
    const Spectrum& heard = spectra[d];
    for (std::size_t b = 0; b < 6; ++b) {
      const Octave octave = octave_at(kCentres[b]);
      double mean = 0;
      for (const int k : {-1, 0, 1}) {
        const double centre = kCentres[b] * std::exp2(k / 3.0), half = std::exp2(1.0 / 6);
        double power = 0, front = 0;
        for (const double hz : source.frequency_hz) {
          if (hz < centre / half || hz >= centre * half) continue;
          const double axis = 2.0 + std::sin(hz / 300);
          power += std::pow(axis * piston(towards.x, hz, 0.06), 2);
          front += axis * axis;
        }
        const double low = k < 0 ? octave.low_hz : centre / half, high = k > 0 ? octave.high_hz : centre * half;
        mean += (high - low) / (octave.high_hz - octave.low_hz) * power / front;
      }
      if (mean < 0.01) continue;
      EXPECT_NEAR(20 * std::log10(std::abs(heard[b] / omni[b])), 10 * std::log10(mean), 0.7) << d << ' ' << kCentres[b];
    }
  }
}

// Lines of a Fourier transform begin at 0 Hz, where a source has no pattern: the line is left out, whatever its level, and the rest is
// heard bit for bit as from a file without it.
TEST_F(SourceFiles, ALineAtZeroHertzIsLeftOut) {
  for (std::uint32_t i = 0; i < 3; ++i) {
    MadeSource source = made_source(kSources[1 + i]);
    const double step_hz = drawn_value(19, i, 20, 60);
    source.frequency_hz.clear();
    for (int k = 1; k * step_hz <= 12000; ++k) source.frequency_hz.push_back(k * step_hz);
    source.add_grid(15, 1.5);
    const SourcePattern audible = source.pattern;
    source.pattern = [=](glm::dvec3 direction, double hz) { return hz > 0 ? audible(direction, hz) : direction.z; };
    const std::vector<glm::dvec3> directions{drawn_direction(20, 2 * i), drawn_direction(20, 2 * i + 1)};
    const std::vector<Spectrum> without = hear(made(source), directions, kCentres);
    source.frequency_hz.insert(source.frequency_hz.begin(), 0.0);
    EXPECT_EQ(hear(made(source, "with_zero.sofa"), directions, kCentres), without) << step_hz;
  }
}

// A source 20 cm off the origin: its phase turns with the direction, its level hardly does.  A sign of that phase would cut zeros.
TEST_F(SourceFiles, PhasesOfAnOffsetCutNoZeros) {
  MadeSource source = made_source(kSources[0]);
  source.pattern = [](glm::dvec3 direction, double hz) { return std::polar(1.0, 2 * kPi * hz / 343 * 0.2 * direction.y); };
  source.add_grid(5, 2);
  const std::string name = made(source);
  const std::vector<std::complex<double>> omni = hear("omni", {{1, 0, 0}}, kCentres)[0];
  std::vector<glm::dvec3> directions;
  for (std::uint32_t d = 0; d < 10; ++d) directions.push_back(drawn_direction(16, d));
  for (const Spectrum& heard : hear(name, directions, kCentres))
    for (std::size_t b = 0; b < kCentres.size(); ++b) EXPECT_NEAR(20 * std::log10(std::abs(heard[b] / omni[b])), 0, 0.3) << kCentres[b];
}

TEST_F(SourceFiles, WrongFilesAreRefusedByName) {
  MadeSource good = made_source(kSources[2]);
  good.add_grid(15, 2);
  good.frequency_hz = {125, 250, 500, 1000, 2000, 4000};
  const auto refused = [&](const char* part, const std::function<void(MadeSource&)>& spoil) {
    MadeSource bad = good;
    spoil(bad);
    expect_bad_input(command(made(bad, "bad.sofa"), {{1, 0, 0}}, "x.wav"), part);
    EXPECT_THAT(read("stderr"), testing::HasSubstr("bad.sofa")) << part;
    EXPECT_FALSE(std::filesystem::exists(file("x.wav"))) << part;
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  refused("not finite in Data.Imag", [&](MadeSource& s) { s.replaced_by = nan; });
  refused("not finite in Data.Imag", [&](MadeSource& s) { s.replaced_by = std::numeric_limits<double>::infinity(); });
  refused("not finite in N", [&](MadeSource& s) { s.frequency_hz[2] = nan; });
  refused("do not rise", [](MadeSource& s) { std::swap(s.frequency_hz[2], s.frequency_hz[3]); });
  refused("outside (0, 1e6]", [](MadeSource& s) { s.frequency_hz[0] = -1; });
  refused("outside (0, 1e6]", [](MadeSource& s) { s.frequency_hz = {0}; });
  refused("outside (0, 1e6]", [](MadeSource& s) { s.frequency_hz[1] = s.frequency_hz[0] = 0; });
  refused("in 'kilohertz' instead of hertz", [](MadeSource& s) { s.frequency_units = "kilohertz"; });
  refused("in 'radian, radian, metre' instead of 'degree, degree, metre'",
          [](MadeSource& s) { s.receiver_units = "radian, radian, metre"; });
  refused("hole of", [](MadeSource& s) { s.in_radians = true; });
  refused("instead of M x R x N", [](MadeSource& s) { s.data_order = "MNR"; });
  refused("instead of M x R x N", [](MadeSource& s) { s.data_order = "NRM"; });
  refused("'SimpleFreeFieldHRTF'", [](MadeSource& s) { s.convention = "SimpleFreeFieldHRTF"; });
  refused("DataType 'FIR'", [](MadeSource& s) { s.data_type = "FIR"; });
  refused("2 measurements (M) of the same directions", [](MadeSource& s) { s.measurements = 2; });
  refused("EmitterPosition off the origin", [](MadeSource& s) { s.emitter_m = 0.1; });
  refused("no level in front at", [](MadeSource& s) { s.pattern = [](glm::dvec3 d, double) { return d.y; }; });
  refused("no level in front at", [](MadeSource& s) { s.pattern = [](glm::dvec3, double) { return 0.0; }; });
  refused("hole of", [](MadeSource& s) {
    s.receivers.clear();
    s.add_grid(10, 1, 0, 0);  // a ring
  });
  for (const char* name : {"N", "Data.Real", "Data.Imag", "ReceiverPosition"}) refused(name, [&](MadeSource& s) { s.left_out = name; });
  // As many receivers as frequencies: the sizes agree, the names of the dimensions do not.
  refused("dimensions MNR instead of MRN", [](MadeSource& s) {
    s.receivers.clear();
    s.add_spiral(40, 1);
    s.frequency_hz.clear();
    for (int k = 0; k < 40; ++k) s.frequency_hz.push_back(100 + 10 * k);
    s.data_order = "MNR";
  });
}

TEST_F(SourceFiles, CutAndDamagedFilesAreRefused) {
  MadeSource source = made_source(kSources[2]);
  source.add_grid(15, 2);
  const std::string whole = source.bytes();
  for (std::uint32_t i = 0; i < 20; ++i) {
    write("cut.sofa", whole.substr(0, static_cast<std::size_t>(drawn_value(21, i, 0, 1) * static_cast<double>(whole.size()))));
    expect_bad_input(command(file("cut.sofa"), {{1, 0, 0}}, "x.wav"), "cut.sofa");
  }
  // Bytes changed anywhere: a value is heard or the file is refused, never anything else.
  for (std::uint32_t i = 0; i < 20; ++i) {
    std::string damaged = whole;
    for (std::uint32_t k = 0; k < 8; ++k)
      damaged[static_cast<std::size_t>(drawn_value(22, 8 * i + k, 0, 1) * 0.999 * static_cast<double>(whole.size()))] ^= 0x5a;
    write("damaged.sofa", damaged);
    const CliOutcome outcome = earshot(command(file("damaged.sofa"), {{1, 0, 0}}, "x.wav"));
    EXPECT_TRUE(outcome.exit_code == 0 || outcome.exit_code == 2) << outcome.errors;
    EXPECT_LE(std::count(outcome.errors.begin(), outcome.errors.end(), '\n'), 1) << outcome.errors;
  }
  expect_bad_input(command(file("absent.sofa"), {{1, 0, 0}}, "x.wav"), "absent.sofa");
}

// CLF text of 5 and 10 degrees, all symmetries: 0.2 dB at bands and directions where the levels are smooth, a grid of 10 degrees twice
// that.
TEST_F(SourceFiles, ClfTextHasItsLevels) {
  const Spectrum omni = hear("omni", {{1, 0, 0}}, kCentres)[0];
  for (std::uint32_t i = 0; i < 4; ++i) {
    const double wide = drawn_value(17, 2 * i, 3, 9), oval = i == 3 ? 0 : drawn_value(17, 2 * i + 1, 1, 3);
    MadeClf made;
    made.level_db = [=](double angle, double around, double) {
      const double sine = std::sin(angle);
      return -wide * (1 - std::cos(angle)) - oval * sine * sine * std::cos(2 * around);
    };
    made.step_deg = i % 2 ? 5 : 10;
    made.symmetry = std::array{"<none>", "<horizontal>", "<full>", "<rotational>"}[i];
    std::vector<glm::dvec3> directions;
    for (std::uint32_t d = 0; d < 10; ++d) directions.push_back(drawn_direction(18, 10 * i + d));
    const std::vector<Spectrum> spectra = hear(write("speaker.tab", made.text()), directions, kCentres);
    for (std::size_t d = 0; d < directions.size(); ++d) {
      const double angle = std::acos(directions[d].x), around = std::atan2(directions[d].y, directions[d].z);
      for (std::size_t b = 0; b < kCentres.size(); ++b)
        EXPECT_NEAR(20 * std::log10(std::abs(spectra[d][b] / omni[b])), made.level_db(angle, around, kCentres[b]), i % 2 ? 0.2 : 0.4)
            << made.symmetry << ' ' << kCentres[b];
    }
  }
}

// Third octaves at 0, -20 and 0 dB off the axis: the octave has their mean power, -1.7 dB, and not the level of its centre.
TEST_F(SourceFiles, OctavesHaveThePowerOfTheirThirdOctaves) {
  MadeClf made{.level_db = [](double angle, double, double hz) { return angle > 0.1 && hz == 1000 ? -20.0 : 0.0; }};
  made.bands_hz = {100, 125, 160, 200, 250, 315, 400, 500, 630, 800, 1000, 1250, 1600, 2000, 2500, 3150, 4000, 5000, 6300, 8000, 10000};
  made.symmetry = "<rotational>";
  const std::vector<glm::dvec3> directions{{0, 1, 0}, drawn_direction(23, 0), {-1, 0, 0}, {1, 0, 0}};
  const Spectrum omni = hear("omni", {{1, 0, 0}}, kCentres)[0];
  const std::vector<Spectrum> spectra = hear(write("thirds.tab", made.text()), directions, kCentres);
  for (std::size_t d = 0; d < directions.size(); ++d)
    for (std::size_t b = 0; b < kCentres.size(); ++b)
      EXPECT_NEAR(20 * std::log10(std::abs(spectra[d][b] / omni[b])), d < 3 && kCentres[b] == 1000 ? -1.7 : 0.0, 0.2) << d << ' ' << b;
}

TEST_F(SourceFiles, ClfTextIsRefusedInOneLine) {
  const std::string good = MadeClf{.level_db = [](double angle, double, double) { return -3 * angle; }}.text();
  const auto refused = [&](const std::string& text, const std::string& name, const char* part) {
    expect_bad_input(command(write(name, text), {{1, 0, 0}}, "x.wav"), part);
    EXPECT_FALSE(std::filesystem::exists(file("x.wav"))) << part;
  };
  refused(good.substr(0, good.size() / 2), "cut.tab", "cut.tab:");
  refused(good.substr(0, good.rfind('.')), "short.tab", "short.tab: ends without <CLF1END>; it is cut short");
  refused(std::string("CLF\0\1\2", 6), "speaker.CF2", "speaker.CF2: is a binary CLF file (CF1, CF2), whose layout is not public");
  refused("", "empty.clf", "empty.clf: does not start with <CLF1>");
  expect_bad_input(command(file("absent.tab"), {{1, 0, 0}}, "x.wav"), "absent.tab");
}

}  // namespace
}  // namespace earshot

#endif
