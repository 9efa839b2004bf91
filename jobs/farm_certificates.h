#pragma once

#include <string>
#include <vector>

#include "common/base/result.h"

namespace pf {

/// PEM texts.
struct Certificates {
  std::string ca;      ///< what processes trust
  std::string ca_key;  ///< only to sign further certificates with
  std::string server;
  std::string server_key;
};

/// A certificate authority for one farm (ECDSA P-256, ten years) and a server certificate signed by it for localhost,
/// 127.0.0.1,
/// ::1 and `hosts` (names or addresses). Errors: kUsage (a host that is neither), kInternal.
[[nodiscard]] Result<Certificates> make_certificates(const std::vector<std::string>& hosts);

}  // namespace pf
