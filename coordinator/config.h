#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "common/base/result.h"
#include "coordinator/retention.h"

namespace pf {

/// What the operator of a farm decides: `config.toml` of the state folder, or the file of --config. A job
/// cannot change any of it.
struct CoordinatorConfig {
  struct Http {
    std::string host;                   ///< empty: 127.0.0.1; any other than this machine needs a certificate
    int port = 0;                       ///< 0: the former one, else any
    std::filesystem::path certificate;  ///< PEM chain; empty: no TLS
    std::filesystem::path key;          ///< PEM; only its owner may read it
    std::filesystem::path ca;           ///< what clients check the certificate by; empty: the certificate itself
  } http;
  struct Limits {
    double requests_per_second = 200;                   ///< of one token, on average
    double request_burst = 1000;                        ///< at once
    std::uint64_t jobs_per_token = 10'000;              ///< that have not ended
    std::uint64_t job_bytes = std::uint64_t{64} << 30;  ///< of a job's files together
    std::uint64_t pixels = std::uint64_t{1} << 28;      ///< of a job's image
  } limits;
  struct Notify {
    std::string url;                    ///< told when a job has ended; empty: nobody
    std::filesystem::path secret_file;  ///< signs what is sent
    std::filesystem::path ca;           ///< for https; empty: the system's
  } notify;
  RetentionPolicy keep;
};

/// Errors: kUsage, with the line and the nearest valid key. Paths are relative to the file's folder.
[[nodiscard]] Result<CoordinatorConfig> load_coordinator_config(const std::filesystem::path& file);

/// An error when others than the owner may read the file.
[[nodiscard]] Result<void> check_secret_mode(const std::filesystem::path& file);

}  // namespace pf
