#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "common/film/film_options.h"
#include "common/film/image.h"
#include "common/film/pass_order.h"
#include "common/film/progressive.h"
#include "common/film/statistics.h"

namespace pf {

/// The state of one progressive image: what single node and coordinator both hold, update and save.
class Film {
 public:
  explicit Film(const FilmOptions& options);

  /// Radii of the open round (kShared) or of sub-pass 0 (kIndependent), per pixel and flow.
  [[nodiscard]] const std::vector<ProgressivePixel>& state() const { return state_; }
  [[nodiscard]] std::vector<ProgressivePixel>& state() { return state_; }
  [[nodiscard]] bool has_radii() const { return has_radii_; }
  void set_initial_radii(std::vector<ProgressivePixel> state);

  [[nodiscard]] std::uint64_t sub_passes() const { return sums_.sub_passes; }
  [[nodiscard]] std::uint64_t round_begin() const { return round_begin_; }
  /// First sub-pass after the open round. Estimators without shared radii have rounds too: there they only say when
  /// stop.error is looked at, so that a job ends after the same sub-pass wherever it runs.
  [[nodiscard]] std::uint64_t round_end() const;
  [[nodiscard]] std::uint64_t rounds() const { return rounds_; }
  [[nodiscard]] const FilmOptions& options() const { return options_; }
  [[nodiscard]] const PassOrder& order() const { return order_; }

  /// Where an integrator adds its sub-passes; they must lie inside the open round and be complete.
  [[nodiscard]] Statistics& sums() { return sums_; }
  [[nodiscard]] const Statistics& sums() const { return sums_; }
  /// The barrier: when the open round is complete, folds its flow into the state and opens the next one.
  void close_round_if_complete();

  /// What the closed rounds did, as one hash: SHA-256 over the link before it and the state that each round left. Two
  /// runs of equal chains had equal states at every barrier; where they part tells the round. 64 zeros before the first
  /// barrier.
  [[nodiscard]] const std::string& round_chain() const { return chain_; }
  /// The same with one link more, the sums that no round has folded in yet: names the film as it is.
  [[nodiscard]] std::string state_chain() const;

  /// The image so far. An open round is folded in tentatively: nothing changes.
  [[nodiscard]] LayeredImage image() const;
  /// The same, made row by row while it is written; the film must outlive it unchanged.
  [[nodiscard]] ImageRows image_rows() const;
  /// Estimated square root of the mean relative squared error (variance only), as compare's relMSE weighs it.
  [[nodiscard]] double estimated_error() const;

  /// Checkpoints: exact, whatever the moment; `identity` names job and scene and must match when read back.
  /// `attachment` is the caller's own text, kept with the film in one atomic step.
  [[nodiscard]] Result<void> save(const std::filesystem::path& file, const std::string& identity,
                                  const std::string& attachment = {}) const;
  [[nodiscard]] static Result<Film> load(const std::filesystem::path& file, const std::string& identity,
                                         std::string* attachment = nullptr);

 private:
  /// What is known of a pixel.
  struct PixelEstimate {
    Rgb direct{0, 0, 0}, specular{0, 0, 0};
    std::array<Rgb, kFlows> flow{Rgb{0, 0, 0}, Rgb{0, 0, 0}};
    std::array<float, kFlows> photons{};  ///< N, or photons found
    std::array<float, kFlows> radius{};   ///< m; of the first hit point
    double variance = 0;                  ///< of the mean luminance
    double bias = 0;                      ///< of the luminance; Extra::kBias
    [[nodiscard]] Rgb all() const { return direct + specular + flow[kCaustic] + flow[kIndirect]; }
  };
  [[nodiscard]] PixelEstimate estimate(std::size_t pixel) const;
  [[nodiscard]] FlowState closed(std::size_t point, Flow flow) const;
  [[nodiscard]] float closed_bias(std::size_t point, Flow flow) const;
  void close_round_at(std::size_t point);
  [[nodiscard]] std::vector<Layer> layers(int first_row, int rows) const;
  /// Radiance of a sum of flux at a hit point that had `samples` eye samples and now has this state.
  [[nodiscard]] double radiance_factor(const FlowState& state, double samples) const;

  /// Eye samples that the pixel has.
  [[nodiscard]] double samples_of(std::size_t pixel) const;

  FilmOptions options_;
  PassOrder order_;
  std::vector<ProgressivePixel> state_;
  Statistics sums_;
  std::vector<std::array<float, kFlows>> bias_;  ///< Extra::kBias: kept as tau is, in steps of SumScale::flow
  std::uint64_t round_begin_ = 0;
  std::uint64_t rounds_ = 0;
  std::string chain_ = std::string(64, '0');
  bool has_radii_ = false;
};

}  // namespace pf
