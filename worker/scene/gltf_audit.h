#pragma once

#include "worker/scene/gltf_accessor.h"
#include "worker/scene/gltf_model.h"

namespace pf::gltf {

/// Faults that cannot touch the image, each named by a warning: values outside an accessor's min and max,
/// values that are not finite where nothing uses them, joints and weights, inverse bind matrices, animations.
void audit(const Model& model, AccessorReader& accessors, Report& report);

// The parts of audit.
void audit_accessors(const Model& model, AccessorReader& accessors, Report& report);
void audit_skins(const Model& model, AccessorReader& accessors, Report& report);
void audit_animations(const Model& model, AccessorReader& accessors, Report& report);

}  // namespace pf::gltf
