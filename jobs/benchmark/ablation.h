#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "common/base/result.h"
#include "jobs/benchmark/schedule.h"

namespace pf::bench {

/// What a plan chose for a method on a scene, or that with one of its terms decided the other way round.
struct Variant {
  std::string term;     ///< the plan's name of it: "caustic map", "absorption", ...; empty: as planned
  std::string planned;  ///< "on" or "off"
  std::string instead;  ///< what decides otherwise: a key, or "out of the materials"
  MethodEntry method;
  Scene scene;  ///< with other materials where the term is one of theirs
};

/// The plan's choice and then one variant for each term of it that can be turned round: of the maps for methods that
/// have them, of guided emission for those that can use it, and what a scene has of sky, lens and materials. What a
/// scene lacks cannot be put in. `plan`: the document of `photonfarm plan --json`. Changed scenes are laid out below
/// `out`/ablations. Errors: kInvalidInput, kInternal.
[[nodiscard]] Result<std::vector<Variant>> variants_of(const nlohmann::json& plan, const Scene& scene,
                                                       const MethodEntry& method, const std::filesystem::path& out);

/// A term turned round against the plan: means over the seeds, at equal passes.
struct Ablation {
  std::size_t method = 0;  ///< of the suite
  std::string algorithm;   ///< that the plan chose
  std::string term, planned, instead;
  double error = 0;                            ///< as planned: relMSE without the worst thousandth of the pixels
  double error_ratio = 0;                      ///< of the variant's to it
  double lowest_ratio = 0, highest_ratio = 0;  ///< of single seeds
  double seconds = 0, seconds_ratio = 0;       ///< of processor time, likewise
  int seeds = 0;                               ///< 0: no figures
  std::string failure;                         ///< why not all seeds are in it; empty: they are
};

/// Of one image.
struct ImageCost {
  double error = 0;    ///< relMSE without the worst thousandth of the pixels
  double seconds = 0;  ///< of processor time
};

/// Adds a seed's pair of images at equal passes to the sums that `finish` makes means of.
void add_pair(Ablation& to, const ImageCost& planned, const ImageCost& other);
void finish(Ablation& ablation);

/// The budget at whose passes terms are turned round: the last but one of a suite, or its only one.
[[nodiscard]] std::size_t ablation_budget(const Suite& suite);

}  // namespace pf::bench
