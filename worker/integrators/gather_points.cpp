#include "worker/integrators/gather_points.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "common/base/parallel.h"
#include "common/math/distribution.h"
#include "common/math/frame.h"
#include "common/math/sampling.h"

namespace pf {
namespace {

/// Direction of the cosine-weighted hemisphere from squared sine and turn, and back.
Vec3f direction_of(const Vec2f& u) {
  const float r = std::sqrt(u.x), phi = 2.0f * kPi * u.y;
  return {r * std::cos(phi), r * std::sin(phi), std::sqrt(std::max(0.0f, 1.0f - u.x))};
}
Vec2f numbers_of(const Vec3f& d) {
  const float turn = std::atan2(d.y, d.x) * (0.5f * kInvPi);
  return {std::min(d.x * d.x + d.y * d.y, kOneMinusEpsilon),
          std::clamp(turn < 0.0f ? turn + 1.0f : turn, 0.0f, kOneMinusEpsilon)};
}

std::array<std::pair<int, int>, 4> square_corners(int x, int y, int edge) {
  return {{{x, y}, {x + edge, y}, {x, y + edge}, {x + edge, y + edge}}};
}

/// Bound of the relative change of irradiance between a gather point and another at this distance, whose
/// normal is tilted [Ward, Rubinstein and Clear 1988, (2)].
float change_bound(const GatherPoint& point, float distance, float cosine) {
  return 4.0f * kInvPi * distance / point.distance + std::sqrt(std::max(0.0f, 2.0f - 2.0f * cosine));
}

}  // namespace

struct HemisphereGather::Histogram {
  std::array<float, kCells> share{};  ///< of the photons
  Distribution1D cells;
  [[nodiscard]] static std::size_t cell(const Vec2f& u) {
    return static_cast<std::size_t>(u.x * kRows) * kColumns + static_cast<std::size_t>(u.y * kColumns);
  }
  /// Density relative to the cosine-weighted hemisphere's.
  [[nodiscard]] float relative_density(const Vec2f& u) const { return share[cell(u)] * static_cast<float>(kCells); }
};

HemisphereGather::HemisphereGather(const MapGather& gather, const JobSpec& spec)
    : gather_(gather),
      importance_(static_cast<float>(spec.final_gather.importance)),
      nearest_(static_cast<std::uint32_t>(spec.photon_map.nearest)) {}

bool HemisphereGather::fill(const Vertex& vertex, Histogram& histogram) const {
  constexpr std::size_t kFewest = 16;  // fewer tell nothing
  const PhotonMap& photons = gather_.indirect_photons();
  if (importance_ <= 0.0f || photons.empty()) return false;
  thread_local NearestPhotons found;
  const float reach = gather_.map().max_distance();
  photons.nearest({vertex.point.position, vertex.bsdf.ng(), reach * reach, nearest_, false}, found);
  if (found.count < kFewest) return false;
  const Frame frame = Frame::from_normal(vertex.bsdf.ns());
  float total = 0.0f;
  for (std::size_t i = 0; i < found.count; ++i) {
    const StoredPhoton& photon = photons.photon(found.index[i]);
    const Vec3f local = frame.to_local(towards_light(photon));
    if (local.z <= 0.0f) continue;
    const float flux = average(unpack_rgbe(photon.flux));
    histogram.share[Histogram::cell(numbers_of(local))] += flux;
    total += flux;
  }
  if (!(total > 0.0f)) return false;
  for (float& share : histogram.share) share /= total;
  histogram.cells = Distribution1D(histogram.share);
  return true;
}

GatherPoint HemisphereGather::at(const Vertex& vertex, const MediumStack& media, int rays, PathRng& rng,
                                 TileFigures& figures) const {
  GatherPoint point;
  point.valid = true;
  point.position = vertex.point.position;
  point.ns = vertex.bsdf.ns();
  point.ng = vertex.bsdf.ng();
  Histogram histogram;
  const int chosen = fill(vertex, histogram) ? static_cast<int>(std::lrint(importance_ * static_cast<float>(rays))) : 0;
  const int rows = std::max(1, static_cast<int>(std::sqrt(0.5f * static_cast<float>(rays - chosen))));
  const int columns = (rays - chosen) / rows;
  const int even = rows * columns, total = even + chosen;
  if (total == 0) return point;
  const Frame frame = Frame::from_normal(point.ns);
  double sum = 0.0, squares = 0.0, inverse_distance = 0.0;
  const auto shoot = [&](const Vec2f& u) {
    const Vec3f local = direction_of(u), d = normalize(frame.to_world(local));
    if (dot(d, point.ng) <= 0.0f) return;
    const auto arrival = gather_.arriving({offset_past(vertex.point, d), d}, media, rng, figures);
    inverse_distance += arrival.distance > 0.0f ? 1.0 / static_cast<double>(arrival.distance) : 0.0;
    // L cos / (n_even cos / pi + n_chosen cos / pi * g): the balance heuristic.
    const float density =
        static_cast<float>(even) + static_cast<float>(chosen) * (chosen > 0 ? histogram.relative_density(u) : 0.0f);
    const Rgb value = arrival.radiance * (kPi / density);
    point.irradiance += value;
    const double l = static_cast<double>(luminance(value));
    sum += l;
    squares += l * l;
  };
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const Vec2f jitter = rng.next2();
      shoot({std::min((static_cast<float>(row) + jitter.x) / static_cast<float>(rows), kOneMinusEpsilon),
             std::min((static_cast<float>(column) + jitter.y) / static_cast<float>(columns), kOneMinusEpsilon)});
    }
  }
  for (int i = 0; i < chosen; ++i) {
    const auto pick = histogram.cells.sample(
        std::min((static_cast<float>(i) + rng.next1()) / static_cast<float>(chosen), kOneMinusEpsilon));
    const Vec2f jitter = rng.next2();
    const std::size_t row = pick->index / kColumns, column = pick->index % kColumns;
    shoot({std::min((static_cast<float>(row) + jitter.x) / kRows, kOneMinusEpsilon),
           std::min((static_cast<float>(column) + jitter.y) / kColumns, kOneMinusEpsilon)});
  }
  if (inverse_distance > 0.0) point.distance = static_cast<float>(total / inverse_distance);
  // Strata make it smaller than this.
  point.error = static_cast<float>(std::sqrt(std::max(0.0, squares - sum * sum / total)));
  return point;
}

GatherPoints::GatherPoints(const Scene& scene, const Eye& eye, const HemisphereGather& gather, const JobSpec& spec)
    : scene_(scene),
      eye_(eye),
      gather_(gather),
      rays_(spec.final_gather.rays),
      error_(static_cast<float>(spec.final_gather.error)),
      seed_(spec.integrator.seed),
      edge_(PassOrder::edge_for(spec.image.width, spec.image.height)),
      columns_((spec.image.width + edge_ - 1) / edge_),
      parts_(static_cast<std::size_t>(columns_) * static_cast<std::size_t>((spec.image.height + edge_ - 1) / edge_)) {}

const GatherPoints::Part& GatherPoints::part_of(int x, int y) const {
  return parts_[static_cast<std::size_t>(y / edge_) * static_cast<std::size_t>(columns_) +
                static_cast<std::size_t>(x / edge_)];
}

std::optional<Vertex> GatherPoints::look(int x, int y, TileFigures& figures) const {
  // The pinhole's ray through the corner, whatever the lens does: points are for many samples.
  const auto ray = eye_.camera().ray({static_cast<float>(x), static_cast<float>(y)}, {0.5f, 0.5f});
  ++figures.rays;
  const auto hit = scene_.intersect({ray.origin, ray.direction});
  if (!hit) return std::nullopt;
  Vertex vertex(scene_, *hit, -ray.direction, eye_.media());
  if (!vertex.bsdf.gather_is_lambert() || is_zero(vertex.bsdf.lambert_f())) return std::nullopt;
  return vertex;
}

void GatherPoints::look_at(Part& part, const std::vector<Square>& squares, int edge) const {
  const std::size_t first = part.points.size();
  std::vector<Square> wanted;
  for (const auto& [x, y] : squares) {
    for (const auto& [cx, cy] : square_corners(x, y, edge)) {
      std::int32_t& number = part.corner[part.index(cx, cy)];
      if (number >= 0) continue;
      number = static_cast<std::int32_t>(first + wanted.size());
      wanted.emplace_back(cx, cy);
    }
  }
  part.points.resize(first + wanted.size());
  std::vector<TileFigures> figures(wanted.size());
  parallel_for(wanted.size(), [&](std::size_t i) {
    const auto vertex = look(wanted[i].first, wanted[i].second, figures[i]);
    if (!vertex) return;
    GatherPoint& point = part.points[first + i];
    point.valid = true;
    point.position = vertex->point.position;
    point.ns = vertex->bsdf.ns();
    point.ng = vertex->bsdf.ng();
  });
  for (const TileFigures& f : figures) part.figures += f;
}

void GatherPoints::gather_at(Part& part, const std::vector<Square>& squares, int edge) const {
  std::vector<Square> wanted;
  for (const auto& [x, y] : squares) {
    for (const auto& [cx, cy] : square_corners(x, y, edge)) {
      GatherPoint& point = part.points[static_cast<std::size_t>(part.corner[part.index(cx, cy)])];
      if (!point.gathered) wanted.emplace_back(cx, cy);
      point.gathered = true;
    }
  }
  std::vector<TileFigures> figures(wanted.size());
  parallel_for(wanted.size(), [&](std::size_t i) {
    const auto [x, y] = wanted[i];
    const auto vertex = look(x, y, figures[i]);
    if (!vertex) return;  // never: the first look saw it
    PathRng rng(seed_, Stream::kIrradiance, static_cast<std::uint64_t>(y), static_cast<std::uint32_t>(x));
    GatherPoint& point = part.points[static_cast<std::size_t>(part.corner[part.index(x, y)])];
    point = gather_.at(*vertex, eye_.media(), rays_, rng, figures[i]);
    point.gathered = true;
  });
  for (const TileFigures& f : figures) part.figures += f;
}

bool GatherPoints::on_one_surface(const Part& part, const Square& square, int edge) {
  const auto corners = part.corners_of(square.first, square.second, edge);
  for (std::size_t i = 0; i < 4; ++i) {
    if (!corners[i]->valid) return false;
    for (std::size_t j = 0; j < i; ++j) {
      const GatherPoint &a = *corners[i], &b = *corners[j];
      const Vec3f between = b.position - a.position;
      constexpr float kMostHeight = 0.25f;  // of the distance: else the corners lie on different surfaces
      const float height = std::max(std::abs(dot(between, a.ng)), std::abs(dot(between, b.ng)));
      if (dot(a.ng, b.ng) <= 0.0f || height > kMostHeight * length(between)) return false;
    }
  }
  return true;
}

bool GatherPoints::interpolates(const Part& part, const Square& square, int edge) const {
  const auto corners = part.corners_of(square.first, square.second, edge);
  for (std::size_t i = 0; i < 4; ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const GatherPoint &a = *corners[i], &b = *corners[j];
      const float distance = length(b.position - a.position), cosine = dot(a.ns, b.ns);
      // No place of the square is farther from its nearest corner than half of the diagonal, nor its normal.
      if (0.5f * std::max(change_bound(a, distance, cosine), change_bound(b, distance, cosine)) > error_) return false;
      const float la = luminance(a.irradiance), lb = luminance(b.irradiance);
      const float noise = 2.0f * std::sqrt(a.error * a.error + b.error * b.error);
      if (std::abs(la - lb) > error_ * (la + lb) + noise) return false;
    }
  }
  return true;
}

std::vector<GatherPoints::Square> GatherPoints::quarters(const Part& part, const std::vector<Square>& squares, int edge,
                                                         const ImagePart& within) {
  std::vector<Square> finer;
  const int half = edge / 2;
  for (const auto& [x, y] : squares) {
    const auto corners = part.corners_of(x, y, edge);
    if (std::ranges::none_of(corners, [](const GatherPoint* point) { return point->valid; })) continue;
    for (const auto& quarter : square_corners(x, y, half)) {
      if (quarter.first < within.x1 && quarter.second < within.y1) finer.push_back(quarter);
    }
  }
  return finer;
}

void GatherPoints::place(const ImagePart& image_part) {
  const std::lock_guard lock(placing_);
  Part& part = parts_[static_cast<std::size_t>(image_part.y0 / edge_) * static_cast<std::size_t>(columns_) +
                      static_cast<std::size_t>(image_part.x0 / edge_)];
  if (part.placed) return;
  part.placed = true;
  part.x0 = image_part.x0;
  part.y0 = image_part.y0;
  const auto squares_along = [](int pixels) { return (pixels + kCoarsest - 1) / kCoarsest * kCoarsest; };
  const int width = squares_along(image_part.x1 - part.x0), height = squares_along(image_part.y1 - part.y0);
  part.columns = width + 1;
  part.corner.assign(static_cast<std::size_t>(part.columns) * static_cast<std::size_t>(height + 1), -1);
  part.square.assign(part.corner.size(), 0);
  std::vector<Square> squares;
  for (int y = part.y0; y < part.y0 + height; y += kCoarsest) {
    for (int x = part.x0; x < part.x0 + width; x += kCoarsest) squares.emplace_back(x, y);
  }
  for (int edge = kCoarsest; edge >= kFinest && !squares.empty(); edge /= 2) {
    look_at(part, squares, edge);
    // Not of std::ranges: clang 14 cannot read libstdc++'s subranges.
    const auto cut = std::stable_partition(squares.begin(), squares.end(),
                                           [&](const Square& square) { return on_one_surface(part, square, edge); });
    const std::vector<Square> whole(squares.begin(), cut);
    std::vector<Square> finer(cut, squares.end());
    gather_at(part, whole, edge);
    for (const Square& square : whole) {
      if (interpolates(part, square, edge))
        part.fill(square, edge);
      else
        finer.push_back(square);
    }
    squares = quarters(part, finer, edge, image_part);
  }
}

bool GatherPoints::interpolate(int x, int y, const Vertex& vertex, Rgb& irradiance) const {
  const Part& part = part_of(x, y);
  const int edge = part.square[part.index(x, y)];
  if (edge == 0) return false;
  // By the pixel's middle in the square: all of its samples weigh the corners alike.
  const int left = x - (x - part.x0) % edge, top = y - (y - part.y0) % edge;
  const float fx = (static_cast<float>(x - left) + 0.5f) / static_cast<float>(edge);
  const float fy = (static_cast<float>(y - top) + 0.5f) / static_cast<float>(edge);
  float total = 0.0f;
  irradiance = {0.0f, 0.0f, 0.0f};
  for (int corner = 0; corner < 4; ++corner) {
    const int right = corner & 1, down = corner >> 1;
    const GatherPoint& point = part.at(left + right * edge, top + down * edge);
    const Vec3f between = vertex.point.position - point.position;
    // A sample may see another surface than the corners do: one within the square is no farther than its
    // diagonal.
    if (change_bound(point, length(between), dot(vertex.bsdf.ns(), point.ns)) > 2.5f * error_) continue;
    const float weight = (right != 0 ? fx : 1.0f - fx) * (down != 0 ? fy : 1.0f - fy);
    irradiance += point.irradiance * weight;
    total += weight;
  }
  constexpr float kLeastWeight = 0.25f;
  if (total < kLeastWeight) return false;
  irradiance /= total;
  return true;
}

bool GatherPoints::marked(int x, int y) const {
  const Part& part = part_of(x, y);
  const std::int32_t number = part.corner[part.index(x, y)];
  return number >= 0 && part.points[static_cast<std::size_t>(number)].gathered;
}

TileFigures GatherPoints::figures_at(int x, int y) const {
  const Part& part = part_of(x, y);
  return x == part.x0 && y == part.y0 ? part.figures : TileFigures{};
}

}  // namespace pf
