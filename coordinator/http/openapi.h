#pragma once

#include <nlohmann/json_fwd.hpp>

namespace pf {

/// The OpenAPI 3 document of the HTTP API. A test holds it against the table of routes, both ways, and its schemas
/// against what the routes answer.
[[nodiscard]] nlohmann::json openapi_document();

}  // namespace pf
