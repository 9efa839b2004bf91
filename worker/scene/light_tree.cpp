#include "worker/scene/light_tree.h"

#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <tuple>

namespace pf {
namespace {

constexpr double kPiD = std::numbers::pi;
/// Slack of the cosines by which a node is culled: single precision loses about this much when angles are
/// subtracted.
constexpr float kCosineSlack = 2e-3f;
/// Least cosine of a node that is not culled.
constexpr float kCosineFloor = 1e-2f;
constexpr float kLargestImportance = 1e30f;
constexpr int kBuckets = 12;
/// Depth below which splits halve the number of lights, so that no input makes the tree deeper than 40 + 32.
constexpr int kDepthOfHalving = 40;

double angle(float cosine) { return std::acos(std::clamp(static_cast<double>(cosine), -1.0, 1.0)); }

/// cos(max(0, a - b)) and sin(max(0, a - b)) for angles in [0, pi] given by their sines and cosines.
float cos_difference(float sin_a, float cos_a, float sin_b, float cos_b) {
  return cos_a > cos_b ? 1.0f : cos_a * cos_b + sin_a * sin_b;
}
float sin_difference(float sin_a, float cos_a, float sin_b, float cos_b) {
  return cos_a > cos_b ? 0.0f : sin_a * cos_b - cos_a * sin_b;
}
float sine(float cosine) { return std::sqrt(std::max(0.0f, 1.0f - cosine * cosine)); }

/// Smallest cone around two cones of normals: axis and cosine of the half-angle [Conty Estevez and Kulla
/// 2018, algorithm 1].
std::pair<Vec3f, float> unite_cones(const LightBounds& a, const LightBounds& b) {
  // The sides of two-sided emitters are alike: turn the second towards the first.
  const bool turn = a.two_sided && b.two_sided && dot(a.axis, b.axis) < 0.0f;
  const Imath::V3d axis_a(a.axis), axis_b = turn ? -Imath::V3d(b.axis) : Imath::V3d(b.axis);
  const double theta_a = angle(a.cos_o), theta_b = angle(b.cos_o);
  const double between = std::atan2(axis_a.cross(axis_b).length(), axis_a.dot(axis_b));
  if (std::min(between + theta_b, kPiD) <= theta_a) return {Vec3f(axis_a), a.cos_o};
  if (std::min(between + theta_a, kPiD) <= theta_b) return {Vec3f(axis_b), b.cos_o};
  const double theta = 0.5 * (theta_a + between + theta_b);
  const Imath::V3d normal = axis_a.cross(axis_b);
  if (theta >= kPiD || normal.length2() < 1e-24) return {Vec3f(axis_a), -1.0f};
  // Turn axis_a by theta - theta_a towards axis_b.
  const Imath::V3d side = normal.normalized().cross(axis_a);
  const double turn_by = theta - theta_a;
  return {Vec3f((axis_a * std::cos(turn_by) + side * std::sin(turn_by)).normalized()),
          static_cast<float>(std::cos(theta))};
}

/// Solid-angle measure of a cone of normals with its spread [Conty Estevez and Kulla 2018, eq. 1].
double orientation_measure(const LightBounds& bounds) {
  const double theta_o = angle(bounds.cos_o);
  const double theta_w = std::min(theta_o + angle(bounds.cos_e), kPiD);
  const double sin_o = std::sin(theta_o), cos_o = std::cos(theta_o);
  return 2.0 * kPiD * (1.0 - cos_o) +
         0.5 * kPiD * (2.0 * theta_w * sin_o - std::cos(theta_o - 2.0 * theta_w) - 2.0 * theta_o * sin_o + cos_o);
}

/// Surface area orientation heuristic of one side of a split. The squared diagonal stands for the area: a row
/// of point lights has a box without any.
double side_cost(const LightBounds& bounds) {
  return static_cast<double>(bounds.energy) * orientation_measure(bounds) *
         static_cast<double>(length2(bounds.box.size()));
}

}  // namespace

LightBounds unite(const LightBounds& a, const LightBounds& b) {
  if (a.box.isEmpty()) return b;
  if (b.box.isEmpty()) return a;
  LightBounds result = a;
  result.box.extendBy(b.box);
  std::tie(result.axis, result.cos_o) = unite_cones(a, b);
  result.cos_e = std::min(a.cos_e, b.cos_e);
  result.energy = a.energy + b.energy;
  result.two_sided = a.two_sided || b.two_sided;
  return result;
}

struct LightTree::Item {
  LightBounds bounds;
  Vec3f center;
  std::uint32_t light = 0;
};

LightTree::LightTree(std::span<const LightBounds> lights) : leaf_(lights.size()) {
  if (lights.empty()) return;
  std::vector<Item> items;
  items.reserve(lights.size());
  for (std::uint32_t i = 0; i < lights.size(); ++i) items.push_back({lights[i], lights[i].box.center(), i});
  nodes_.reserve(2 * lights.size() - 1);
  build(items, 0, kNone);
}

std::uint32_t LightTree::build(std::span<Item> items, int depth, std::uint32_t parent) {
  LightBounds bounds;
  for (const Item& item : items) bounds = unite(bounds, item.bounds);
  const auto index = static_cast<std::uint32_t>(nodes_.size());
  Node node;
  node.center = bounds.box.center();
  node.radius2 = 0.25f * length2(bounds.box.size());
  node.axis = bounds.axis;
  node.cos_o = bounds.cos_o;
  node.sin_o = sine(bounds.cos_o);
  node.cos_e = bounds.cos_e;
  node.energy = bounds.energy;
  node.two_sided = bounds.two_sided;
  node.parent = parent;
  nodes_.push_back(node);
  if (items.size() == 1) {
    nodes_[index].light = items[0].light;
    leaf_[items[0].light] = index;
    return index;
  }
  const std::size_t middle = split(items, bounds, depth);
  build(items.first(middle), depth + 1, index);
  const std::uint32_t right = build(items.subspan(middle), depth + 1, index);
  nodes_[index].right = right;
  return index;
}

/// Orders `items` so that the first k go left, and returns k.
std::size_t LightTree::split(std::span<Item> items, const LightBounds& bounds, int depth) {
  Box3f centers;
  for (const Item& item : items) centers.extendBy(item.center);
  const Vec3f size = centers.size();
  const float longest = max_component(bounds.box.size());
  double best_cost = std::numeric_limits<double>::infinity();
  int best_axis = -1, best_bucket = 0;
  const auto bucket_of = [&](const Item& item, int axis) {
    const float t = (item.center[axis] - centers.min[axis]) / size[axis];
    return std::clamp(static_cast<int>(t * kBuckets), 0, kBuckets - 1);
  };
  for (int axis = 0; axis < 3 && depth < kDepthOfHalving; ++axis) {
    if (!(size[axis] > 0.0f)) continue;
    std::array<LightBounds, kBuckets> buckets, from_right;
    for (const Item& item : items) {
      LightBounds& bucket = buckets[static_cast<std::size_t>(bucket_of(item, axis))];
      bucket = unite(bucket, item.bounds);
    }
    from_right[kBuckets - 1] = buckets[kBuckets - 1];
    for (std::size_t i = kBuckets - 1; i-- > 0;) from_right[i] = unite(buckets[i], from_right[i + 1]);
    const double stretch = static_cast<double>(longest / std::max(bounds.box.size()[axis], 1e-6f * longest));
    LightBounds left;
    for (std::size_t i = 0; i + 1 < kBuckets; ++i) {
      left = unite(left, buckets[i]);
      if (left.box.isEmpty() || from_right[i + 1].box.isEmpty()) continue;
      const double cost = stretch * (side_cost(left) + side_cost(from_right[i + 1]));
      if (cost < best_cost) {
        best_cost = cost;
        best_axis = axis;
        best_bucket = static_cast<int>(i);
      }
    }
  }
  if (best_axis < 0) {  // all in one place, or too deep: halves, along the longest axis
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : (size.y >= size.z ? 1 : 2);
    std::stable_sort(items.begin(), items.end(),
                     [axis](const Item& a, const Item& b) { return a.center[axis] < b.center[axis]; });
    return items.size() / 2;
  }
  const auto middle = std::stable_partition(
      items.begin(), items.end(), [&](const Item& item) { return bucket_of(item, best_axis) <= best_bucket; });
  return static_cast<std::size_t>(middle - items.begin());
}

/// Estimated irradiance from a node [Conty Estevez and Kulla 2018, eq. 3]: energy over squared distance, with
/// the cosines at the emitters and at the receiver as large as they can be for anything inside the node's
/// sphere.
float LightTree::node_importance(const Node& node, const Receiver& receiver) {
  const Vec3f d = node.center - receiver.p;
  const float d2 = length2(d);
  if (!(d2 > node.radius2)) return std::min(node.energy / std::max(node.radius2, 1e-30f), kLargestImportance);
  const float inverse_d = 1.0f / std::sqrt(d2);
  const float sin_b = std::sqrt(node.radius2) * inverse_d;  // half-angle of the sphere
  const float cos_b = sine(sin_b);

  float cos_w = -dot(node.axis, d) * inverse_d;
  if (node.two_sided) cos_w = std::abs(cos_w);
  const float sin_w = sine(cos_w);
  const float cos_x = cos_difference(sin_w, cos_w, node.sin_o, node.cos_o);
  const float sin_x = sin_difference(sin_w, cos_w, node.sin_o, node.cos_o);
  const float cos_emitted = cos_difference(sin_x, cos_x, sin_b, cos_b);
  if (cos_emitted < node.cos_e - kCosineSlack) return 0.0f;

  float cos_i = dot(receiver.n, d) * inverse_d;
  if (receiver.transmissive) cos_i = std::abs(cos_i);
  const float cos_received = cos_difference(sine(cos_i), cos_i, sin_b, cos_b);
  if (cos_received < -kCosineSlack) return 0.0f;

  return std::min(node.energy / d2 * std::max(cos_emitted, kCosineFloor) * std::max(cos_received, kCosineFloor),
                  kLargestImportance);
}

}  // namespace pf
