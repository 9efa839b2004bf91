#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"

namespace pf {

/// What a token may do; each may also do what stands before it.
enum class Role {
  kRead,    ///< look at everything
  kSubmit,  ///< send and steer jobs
  kAdmin    ///< workers, tokens, removing jobs
};
[[nodiscard]] std::string_view to_string(Role role);
[[nodiscard]] std::optional<Role> role_of(std::string_view text);

/// Who asks.
struct Caller {
  std::string name;  ///< of the token
  Role role = Role::kRead;
};

struct TokenView {
  std::string name;
  Role role = Role::kRead;
  std::int64_t created_unix_ms = 0;
};

/// The tokens that open the API: that of STATE/token, which is admin, and those that were made through the
/// API, of which STATE/tokens.json keeps name, role and SHA-256 alone. A plain hash is enough: a token is 32
/// random bytes, so that guessing its preimage is as hard as guessing the token, and a slow hash, which
/// protects short passwords, would only cost each request time. May be used from any thread.
class TokenStore {
 public:
  static constexpr std::string_view kBootstrap = "bootstrap";  ///< name of the token in STATE/token

  /// Errors: kInvalidInput for a broken file.
  [[nodiscard]] static Result<std::unique_ptr<TokenStore>> open(const std::filesystem::path& state,
                                                                std::string_view bootstrap);

  /// Whose token this is. Takes equally long for all wrong ones.
  [[nodiscard]] std::optional<Caller> find(std::string_view token) const;
  [[nodiscard]] std::vector<TokenView> list() const;
  /// The new token, which nobody can see again. Errors: kInvalidInput for a name that is taken or no name;
  /// kInternal.
  [[nodiscard]] Result<std::string> create(const std::string& name, Role role, std::int64_t now_unix_ms);
  /// Errors: kUsage when there is none of this name; kInvalidInput for the one of STATE/token; kInternal.
  [[nodiscard]] Result<void> revoke(const std::string& name);

 private:
  struct Entry {
    TokenView view;
    std::string sha256;
  };
  TokenStore(std::filesystem::path file, std::string_view bootstrap);
  [[nodiscard]] Result<void> load();
  [[nodiscard]] Result<void> save(const std::vector<Entry>& entries) const;

  const std::filesystem::path file_;
  mutable std::mutex mutex_;
  std::vector<Entry> entries_;  ///< the first is that of STATE/token and is not saved
};

}  // namespace pf
