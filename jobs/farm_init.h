#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "jobs/command.h"

namespace pf {

struct FarmInitOptions {
  std::filesystem::path folder;    ///< made; must be absent or empty
  std::vector<std::string> hosts;  ///< of the server, beside localhost; the first goes into the credentials
  int workers = 16;
  int port = 4222;
};

/// What a farm of several machines needs: a private certificate authority, a server certificate, a nats-server.conf
/// with TLS and one user for each process, and each process's credentials. Errors: kUsage, kInternal; an existing file
/// is never touched.
[[nodiscard]] Result<void> make_farm_folder(const FarmInitOptions& options);

/// `photonfarm farm init`
[[nodiscard]] int run_farm_init_command(const Context& context, const Arguments& arguments);

}  // namespace pf
