#include "worker/photon/emission_guide.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "common/math/sampling.h"

namespace pf {
namespace {

/// Cells with fewer examples of worth are not cut: each would follow single photons. 32 made half the gain on the
/// example scenes, of whose paths few matter.
constexpr double kLeastExamples = 8.0;
/// A cell's mean counts as so many examples of the cell around it.
constexpr double kPriorExamples = 4.0;
constexpr std::uint32_t kMostDepth = 30;

double mean_of(double squares, double volume, double examples) { return squares / (volume * examples); }

}  // namespace

struct EmissionGuide::Builder {
  std::vector<Example>& examples;
  std::vector<Node>& nodes;
  /// Per node, for the second walk.
  struct Cell {
    double volume = 1.0;
    double deviation = 0.0;  ///< root of the mean square, of leaves
  };
  std::vector<Cell> cells;
  std::size_t leaves = 0;

  /// Sums over some examples of a cell.
  struct Sums {
    double squares = 0.0;    ///< by weight
    double moment = 0.0;     ///< of the squares
    std::size_t trials = 0;  ///< examples
    void add(const Example& e) {
      const double square = e.weight * e.worth;
      squares += square;
      moment += square * square;
      ++trials;
    }
    /// Examples of equal worth that would tell as much.
    [[nodiscard]] double effective() const { return moment > 0.0 ? squares * squares / moment : 0.0; }
  };

  [[nodiscard]] double smoothed(const Sums& sums, double volume, double around) const {
    const auto trials = static_cast<double>(sums.trials);
    const double own = mean_of(sums.squares, volume, static_cast<double>(examples.size()));
    return (own * trials + around * kPriorExamples) / (trials + kPriorExamples);
  }

  void build(std::uint32_t node, std::span<Example> all, Numbers low, Numbers width, double volume, double around,
             std::uint32_t depth) {
    Sums sums;
    for (const Example& e : all) sums.add(e);
    const double mean = smoothed(sums, volume, around);
    std::size_t best = kNumbers;
    if (depth < kMostDepth && sums.effective() >= kLeastExamples) best = best_axis(all, low, width, volume, mean);
    if (best == kNumbers) {
      cells[node] = {volume, std::sqrt(mean)};
      ++leaves;
      return;
    }
    const float middle = low[best] + 0.5f * width[best];
    const auto upper = std::partition(all.begin(), all.end(), [&](const Example& e) { return e.u[best] < middle; });
    const auto lower_count = static_cast<std::size_t>(upper - all.begin());
    const auto child = static_cast<std::uint32_t>(nodes.size());
    nodes.resize(nodes.size() + 2);
    cells.resize(nodes.size());
    nodes[node].child = child;
    nodes[node].axis = static_cast<std::uint32_t>(best);
    width[best] *= 0.5f;
    build(child, all.first(lower_count), low, width, 0.5 * volume, mean, depth + 1);
    low[best] = middle;
    build(child + 1, all.subspan(lower_count), low, width, 0.5 * volume, mean, depth + 1);
  }

  /// The number whose halves differ most; kNumbers where all are alike.
  [[nodiscard]] std::size_t best_axis(std::span<const Example> all, const Numbers& low, const Numbers& width,
                                      double volume, double mean) const {
    std::array<std::array<Sums, 2>, kNumbers> halves;
    for (const Example& e : all) {
      for (std::size_t a = 0; a < kNumbers; ++a) halves[a][e.u[a] < low[a] + 0.5f * width[a] ? 0 : 1].add(e);
    }
    std::size_t best = kNumbers;
    // Less than a thousandth less deviation is chance, and not worth a step on every photon's way.
    double least = std::sqrt(mean) * (1.0 - 1e-3);
    for (std::size_t a = 0; a < kNumbers; ++a) {
      const double deviation = 0.5 * (std::sqrt(smoothed(halves[a][0], 0.5 * volume, mean)) +
                                      std::sqrt(smoothed(halves[a][1], 0.5 * volume, mean)));
      if (deviation < least) {
        least = deviation;
        best = a;
      }
    }
    return best;
  }

  /// Probability of a node, once its leaves are known; sets where draw() turns off.
  double weigh(std::uint32_t node, double total) {
    if (nodes[node].child == 0)
      return cells[node].volume * ((1.0 - kUniformShare) * cells[node].deviation / total + kUniformShare);
    const double lower = weigh(nodes[node].child, total), upper = weigh(nodes[node].child + 1, total);
    // A multiple of the step of random numbers: what draw() does is what the weights say.
    constexpr double kStep = 0x1p-24;
    nodes[node].lower =
        static_cast<float>(kStep * std::clamp(std::round(lower / (lower + upper) / kStep), 1.0, 1.0 / kStep - 1.0));
    return lower + upper;
  }
  void set_weights(std::uint32_t node, double probability) {
    if (nodes[node].child == 0) {
      nodes[node].weight = static_cast<float>(cells[node].volume / probability);
      return;
    }
    const double lower = nodes[node].lower;
    set_weights(nodes[node].child, probability * lower);
    set_weights(nodes[node].child + 1, probability * (1.0 - lower));
  }
};

EmissionGuide::EmissionGuide(std::vector<Example> examples) {
  double squares = 0.0;
  for (const Example& e : examples) squares += e.weight * e.worth;
  if (!(squares > 0.0) || !std::isfinite(squares)) return;
  nodes_.resize(1);
  Builder builder{examples, nodes_, std::vector<Builder::Cell>(1)};
  Numbers width;
  width.fill(1.0f);
  builder.build(0, examples, Numbers{}, width, 1.0, mean_of(squares, 1.0, static_cast<double>(examples.size())), 0);
  double total = 0.0;
  for (const Builder::Cell& cell : builder.cells) total += cell.volume * cell.deviation;
  builder.weigh(0, total);
  builder.set_weights(0, 1.0);
  cells_ = builder.leaves;
}

EmissionGuide::Drawn EmissionGuide::draw(const Numbers& uniform) const {
  if (nodes_.empty()) return {uniform, 1.0f};
  Numbers u = uniform, low{}, width;
  width.fill(1.0f);
  const Node* node = nodes_.data();
  while (node->child != 0) {
    const std::uint32_t a = node->axis;
    width[a] *= 0.5f;
    if (u[a] < node->lower) {
      u[a] /= node->lower;
      node = &nodes_[node->child];
    } else {
      u[a] = (u[a] - node->lower) / (1.0f - node->lower);
      low[a] += width[a];
      node = &nodes_[node->child + 1];
    }
    u[a] = std::min(u[a], kOneMinusEpsilon);
  }
  for (std::size_t a = 0; a < kNumbers; ++a) u[a] = std::min(low[a] + u[a] * width[a], kOneMinusEpsilon);
  return {u, node->weight};
}

}  // namespace pf
