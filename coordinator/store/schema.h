#pragma once

#include "common/base/result.h"
#include "coordinator/store/sqlite.h"

namespace pf {

/// The latest version of the database's schema.
[[nodiscard]] int schema_version();

/// Brings a database to the latest version, each step whole or not at all. Error: kUsage when it is of a later one than
/// this program knows.
[[nodiscard]] Result<void> migrate(const Database& database);

}  // namespace pf
