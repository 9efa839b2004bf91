#pragma once

#include <filesystem>
#include <string>

#include "common/base/result.h"

namespace pf {

/// `photonfarm compare IMAGE.exr REFERENCE.exr [--json] [--error-image FILE.png|FILE.exr]`
struct CompareOptions {
  std::filesystem::path image;
  std::filesystem::path reference;
  bool json = false;
  std::filesystem::path error_image;  ///< none if empty
};

/// For --help of the option.
inline constexpr const char* kErrorImageHelp =
    "also write where the images differ: FILE.png shows the HDR-FLIP error in magma colours (black 0, yellow "
    "1); "
    "FILE.exr holds the squared error relative to the reference in R, G, B and the HDR-FLIP error in flip.Y";

/// Compares the beauty of two EXR images, and layers with colours that both have. Returns what to print: a
/// table, or one JSON document, each ending in a new line. Errors: kUsage for an error image that is neither
/// .png nor .exr; kInvalidInput, naming the file, for unreadable images, other sizes or non-finite pixels;
/// kInternal if the error image cannot be written.
[[nodiscard]] Result<std::string> run_compare(const CompareOptions& options);

}  // namespace pf
