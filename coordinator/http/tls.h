#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "common/base/result.h"

struct ssl_ctx_st;

namespace pf {

/// A server's certificate and key, ready for connections: TLS 1.2 and 1.3.
class TlsContext {
 public:
  /// Errors: kUsage, naming the file: missing, broken, a key that others may read or that is of another
  /// certificate.
  [[nodiscard]] static Result<std::unique_ptr<TlsContext>> load(const std::filesystem::path& certificate,
                                                                const std::filesystem::path& key);
  [[nodiscard]] ::ssl_ctx_st* get() const { return context_.get(); }

 private:
  struct Free {
    void operator()(::ssl_ctx_st* context) const;
  };
  TlsContext() = default;
  std::unique_ptr<::ssl_ctx_st, Free> context_;
};

/// True when nobody but this machine reaches an address of this name: 127.0.0.0/8, ::1, localhost.
[[nodiscard]] bool is_loopback(const std::string& host);

}  // namespace pf
