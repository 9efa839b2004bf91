#include "worker/photon/irradiance_cache.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace pf {
namespace {

/// Deeper cells hold the smallest records together: a cell is then a millionth of the scene wide.
constexpr int kMaxDepth = 20;
/// A record may lie so far in front of a point, as a part of its radius, before it no longer counts there.
constexpr float kFrontTolerance = 0.01f;
/// Records that face away from each other by more bound each other's radius no more: they lie on two sides of
/// a wall.
constexpr float kOppositeCosine = -0.5f;
/// Neighbours are sought within so many times the distance that a record reaches: farther ones are bound
/// through those between.
constexpr float kNeighbourhood = 3.0f;

}  // namespace

void set_estimate(IrradianceRecord& record, const IrradianceEstimate& estimate) {
  record.irradiance = estimate.irradiance;
  record.rotation = estimate.rotation;
  record.translation = estimate.translation;
  const Vec3f steepest{luminance({estimate.translation[0].x, estimate.translation[1].x, estimate.translation[2].x}),
                       luminance({estimate.translation[0].y, estimate.translation[1].y, estimate.translation[2].y}),
                       luminance({estimate.translation[0].z, estimate.translation[1].z, estimate.translation[2].z})};
  const float slope = length(steepest);
  float radius = estimate.harmonic_distance;
  if (slope > 0.0f) radius = std::min(radius, luminance(estimate.irradiance) / slope);
  if (radius < record.least) {
    for (Vec3f& g : record.translation) g *= radius / record.least;
  }
  record.radius = std::clamp(radius, record.least, record.most);
}

IrradianceCache::IrradianceCache(const Box3f& bounds, float error)
    : nodes_(1), centre_(bounds.center()), edge_(std::max(max_component(bounds.size()), 1e-30f)), error_(error) {}

float IrradianceCache::weight(const IrradianceRecord& record, const Vec3f& position, const Vec3f& normal, float error) {
  const Vec3f offset = position - record.position;
  const float reach = error * record.radius;
  const float distance2 = length2(offset);
  if (!(distance2 < reach * reach)) return 0.0f;
  const float cosine = dot(normal, record.normal);
  const float estimated = std::sqrt(distance2) / record.radius + std::sqrt(std::max(0.0f, 1.0f - cosine));
  if (!(estimated < error)) return 0.0f;
  // In front of the point the record may see what the point does not [Ward 1988, (5)].
  if (0.5f * dot(offset, normal + record.normal) < -kFrontTolerance * record.radius) return 0.0f;
  return 1.0f - estimated / error;
}

std::optional<Rgb> IrradianceCache::interpolate(const Vec3f& position, const Vec3f& normal, float tightness) const {
  const float error = error_ * tightness;
  Rgb sum{0, 0, 0};
  float weights = 0.0f;
  for (Cell cell = root();;) {
    for (const std::uint32_t index : nodes_[cell.node].records) {
      const IrradianceRecord& record = records_[index];
      const float w = weight(record, position, normal, error) * static_cast<float>(record.rays);
      if (!(w > 0.0f)) continue;
      // [Ward and Heckbert 1992, (4)]
      const Rgb value = record.irradiance + change_along(record.rotation, cross(record.normal, normal)) +
                        change_along(record.translation, position - record.position);
      sum += Rgb{std::max(value.x, 0.0f), std::max(value.y, 0.0f), std::max(value.z, 0.0f)} * w;
      weights += w;
    }
    const unsigned octant = (position.x >= cell.centre.x ? 1u : 0u) | (position.y >= cell.centre.y ? 2u : 0u) |
                            (position.z >= cell.centre.z ? 4u : 0u);
    const std::uint32_t next = nodes_[cell.node].children[octant];
    if (next == kNone) break;
    cell = child(cell, octant, next);
  }
  if (!(weights > 0.0f)) return std::nullopt;
  return sum / weights;
}

IrradianceCache::Cell IrradianceCache::child(const Cell& cell, unsigned octant, std::uint32_t node) {
  const float quarter = 0.25f * cell.edge;
  const Vec3f towards{octant & 1u ? quarter : -quarter, octant & 2u ? quarter : -quarter,
                      octant & 4u ? quarter : -quarter};
  return {node, cell.centre + towards, 0.5f * cell.edge, cell.depth + 1};
}

bool IrradianceCache::reaches(const Cell& cell, unsigned octant, const Vec3f& position, float radius) {
  for (int axis = 0; axis < 3; ++axis) {
    const float offset = position[axis] - cell.centre[axis];
    if (octant & (1u << axis) ? offset + radius < 0.0f : offset - radius >= 0.0f) return false;
  }
  return true;
}

/// Puts the record into all cells of about its size that its ball reaches: at most eight, so that a reader
/// goes straight down.
void IrradianceCache::place(std::uint32_t index, float radius) {
  std::vector<Cell> pending{root()};
  const Vec3f position = records_[index].position;
  while (!pending.empty()) {
    const Cell cell = pending.back();
    pending.pop_back();
    if (cell.depth == kMaxDepth || 0.5f * cell.edge < 2.0f * radius) {
      nodes_[cell.node].records.push_back(index);
      continue;
    }
    for (unsigned octant = 0; octant < 8; ++octant) {
      if (!reaches(cell, octant, position, radius)) continue;
      if (nodes_[cell.node].children[octant] == kNone) {
        nodes_[cell.node].children[octant] = static_cast<std::uint32_t>(nodes_.size());
        nodes_.emplace_back();
      }
      pending.push_back(child(cell, octant, nodes_[cell.node].children[octant]));
    }
  }
}

/// What is near to a neighbour may be that near here as well: R_i <= R_j + |p_i - p_j|, both ways [Krivanek
/// 2006, 4].
void IrradianceCache::clamp_to_neighbours(IrradianceRecord& record) {
  std::vector<Cell> pending{root()};
  std::vector<std::uint32_t> near;
  const float within = std::min(1.0f, kNeighbourhood * error_) * record.radius;
  while (!pending.empty()) {
    const Cell cell = pending.back();
    pending.pop_back();
    near.insert(near.end(), nodes_[cell.node].records.begin(), nodes_[cell.node].records.end());
    for (unsigned octant = 0; octant < 8; ++octant) {
      const std::uint32_t next = nodes_[cell.node].children[octant];
      if (next != kNone && reaches(cell, octant, record.position, within)) pending.push_back(child(cell, octant, next));
    }
  }
  const auto bounds = [&](const IrradianceRecord& a, const IrradianceRecord& b) {
    return dot(a.normal, b.normal) > kOppositeCosine;
  };
  for (const std::uint32_t index : near) {
    const IrradianceRecord& other = records_[index];
    if (!bounds(record, other)) continue;
    record.radius = std::min(record.radius, other.radius + length(record.position - other.position));
  }
  record.radius = std::max(record.radius, record.least);
  for (const std::uint32_t index : near) {
    IrradianceRecord& other = records_[index];
    if (!bounds(record, other)) continue;
    other.radius =
        std::max(other.least, std::min(other.radius, record.radius + length(record.position - other.position)));
  }
}

void IrradianceCache::insert(const IrradianceRecord& record) {
  IrradianceRecord bounded = record;
  clamp_to_neighbours(bounded);
  records_.push_back(bounded);
  place(static_cast<std::uint32_t>(records_.size() - 1), error_ * bounded.radius);
}

void IrradianceCache::assign(std::vector<IrradianceRecord> records) {
  records_ = std::move(records);
  nodes_.assign(1, Node());
  for (std::uint32_t i = 0; i < records_.size(); ++i) place(i, error_ * records_[i].radius);
}

}  // namespace pf
