#pragma once

#include <filesystem>

namespace pf::test {

// Where this checkout and its build lie. One small file knows, so that all others compile alike in every folder.

/// The repository.
[[nodiscard]] std::filesystem::path source_dir();
/// The programs of this build.
[[nodiscard]] std::filesystem::path bin_dir();
/// Test data that is too large for the repository: `shared` beside it. A test that needs it skips where it is absent.
[[nodiscard]] std::filesystem::path shared_dir();

}  // namespace pf::test
