#pragma once

#include <vector>

#include "common/base/hash.h"
#include "common/base/result.h"
#include "common/math/vec.h"
#include "worker/scene/scene_description.h"

namespace pf {

/// A part of a scene that can change by itself: a mesh where it is placed, or a lamp. Two parts of equal hash
/// are alike in all that light can depend on.
struct ScenePart {
  Hash128 hash;
  Box3f bounds;         ///< empty for lights from outside the scene
  Rgb flux{0, 0, 0};    ///< that it emits [W], roughly: for telling how far it matters
  Vec3f axis{0, 0, 1};  ///< of a spot light
  float cosine = -1;    ///< of the cone around `axis` into which it shines
  [[nodiscard]] bool everywhere() const { return bounds.isEmpty(); }
};

/// The parts of a scene, in its own order. Errors: kInvalidInput, a texture or environment file that cannot
/// be read.
[[nodiscard]] Result<std::vector<ScenePart>> scene_parts(const SceneDescription& scene);

/// What differs between two scenes.
struct SceneChange {
  std::vector<Box3f> boxes;            ///< of parts that are gone or new, a little enlarged; a moved part has two
  std::vector<ScenePart> gone_lights;  ///< parts that shone and are gone
  bool everywhere = false;             ///< a light from outside the scene changed
  [[nodiscard]] bool empty() const { return boxes.empty() && !everywhere; }
  [[nodiscard]] bool holds(const Vec3f& point) const;
  /// Whether the segment origin + t * direction, t in (0, length), passes one of the boxes; the first `t`
  /// inside of one goes to `enter`.
  [[nodiscard]] bool crossed(const Vec3f& origin, const Vec3f& direction, float length, float* enter = nullptr) const;
};
[[nodiscard]] SceneChange change_between(const std::vector<ScenePart>& before, const std::vector<ScenePart>& after);

}  // namespace pf
