#pragma once

#include <span>

#include "coordinator/http/web_routes.h"

namespace pf {

/// The dashboard: bundle.mjs writes the definition, from src/.
[[nodiscard]] std::span<const WebFile> web_files();

}  // namespace pf
