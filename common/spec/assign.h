#pragma once

#include <string>

#include "common/base/result.h"
#include "common/spec/document.h"
#include "common/spec/key_table.h"

namespace pf::spec {

/// Checks `value` against what `key` takes and stores it in `spec`. Errors: kInvalidSpec, without the place:
/// `what is wrong; what was expected; nearest valid name`.
[[nodiscard]] Result<void> assign(JobSpec& spec, const Key& key, const Value& value);

}  // namespace pf::spec
