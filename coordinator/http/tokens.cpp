#include "coordinator/http/tokens.h"

#include <algorithm>
#include <array>
#include <system_error>
#include <utility>

#include <fmt/format.h>
#include <openssl/crypto.h>
#include <nlohmann/json.hpp>

#include "common/base/atomic_file.h"
#include "common/base/hash.h"
#include "coordinator/http/state.h"

namespace pf {
namespace {

using nlohmann::json;

constexpr std::array<std::pair<Role, std::string_view>, 3> kRoles = {
    {{Role::kRead, "read"}, {Role::kSubmit, "submit"}, {Role::kAdmin, "admin"}}};
constexpr std::size_t kMaxTokens = 1000;
constexpr std::uint64_t kMaxFileBytes = 1 << 20;

bool is_token_name(std::string_view name) {
  return !name.empty() && name.size() <= 64 &&
         name.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789-") == std::string_view::npos;
}

}  // namespace

std::string_view to_string(Role role) {
  for (const auto& [value, text] : kRoles) {
    if (value == role) return text;
  }
  return "";
}

std::optional<Role> role_of(std::string_view text) {
  for (const auto& [value, name] : kRoles) {
    if (name == text) return value;
  }
  return std::nullopt;
}

TokenStore::TokenStore(std::filesystem::path file, std::string_view bootstrap) : file_(std::move(file)) {
  Entry& entry = entries_.emplace_back();
  entry.view = TokenView{std::string(kBootstrap), Role::kAdmin, 0};
  entry.sha256 = sha256_hex(bootstrap);
}

Result<std::unique_ptr<TokenStore>> TokenStore::open(const std::filesystem::path& state, std::string_view bootstrap) {
  std::unique_ptr<TokenStore> store(new TokenStore(state / "tokens.json", bootstrap));
  if (auto loaded = store->load(); !loaded) return tl::unexpected(loaded.error());
  return store;
}

Result<void> TokenStore::load() {
  std::error_code error;
  if (!std::filesystem::exists(file_, error)) return {};
  const auto text = read_file(file_, kMaxFileBytes);
  if (!text) return tl::unexpected(text.error());
  const auto broken = [&] {
    return fail(
        ErrorKind::kInvalidInput,
        fmt::format("{}: is damaged; remove it, and make its tokens anew: photonfarm token create", file_.string()));
  };
  const json document = json::parse(*text, nullptr, false);
  if (!document.is_object() || !document.contains("tokens") || !document["tokens"].is_array()) return broken();
  for (const json& token : document["tokens"]) {
    if (!token.is_object()) return broken();
    const auto member = [&](const char* name) {
      const auto found = token.find(name);
      return found != token.end() && found->is_string() ? found->get<std::string>() : std::string();
    };
    const auto role = role_of(member("role"));
    if (!role || !is_token_name(member("name")) || member("sha256").size() != 64) return broken();
    const auto created = token.find("created_unix_ms");
    const bool dated = created != token.end() && created->is_number_integer();
    Entry& entry = entries_.emplace_back();
    entry.view = TokenView{member("name"), *role, dated ? created->get<std::int64_t>() : 0};
    entry.sha256 = member("sha256");
  }
  return {};
}

Result<void> TokenStore::save(const std::vector<Entry>& entries) const {
  json tokens = json::array();
  for (const Entry& entry : entries) {
    if (entry.view.name == kBootstrap) continue;
    tokens.push_back({{"name", entry.view.name},
                      {"role", to_string(entry.view.role)},
                      {"created_unix_ms", entry.view.created_unix_ms},
                      {"sha256", entry.sha256}});
  }
  return write_file_atomically(file_, json{{"tokens", std::move(tokens)}}.dump(2) + "\n", FileAccess::kOwnerOnly);
}

std::optional<Caller> TokenStore::find(std::string_view token) const {
  const std::string hash = sha256_hex(token);
  std::optional<Caller> caller;
  const std::lock_guard lock(mutex_);
  // All of them, each to its end: how long it takes says nothing.
  for (const Entry& entry : entries_) {
    if (CRYPTO_memcmp(entry.sha256.data(), hash.data(), hash.size()) == 0)
      caller = Caller{entry.view.name, entry.view.role};
  }
  return caller;
}

std::vector<TokenView> TokenStore::list() const {
  const std::lock_guard lock(mutex_);
  std::vector<TokenView> views;
  for (const Entry& entry : entries_) views.push_back(entry.view);
  return views;
}

Result<std::string> TokenStore::create(const std::string& name, Role role, std::int64_t now_unix_ms) {
  if (!is_token_name(name)) {
    return fail(ErrorKind::kInvalidInput,
                fmt::format("name '{}': expected 1 to 64 of the characters a-z, 0-9 and -", name));
  }
  auto token = new_token();
  if (!token) return token;
  const std::lock_guard lock(mutex_);
  for (const Entry& entry : entries_) {
    if (entry.view.name == name)
      return fail(ErrorKind::kInvalidInput,
                  fmt::format("name '{}': a token of this name exists; revoke it first", name));
  }
  if (entries_.size() > kMaxTokens)
    return fail(ErrorKind::kInvalidInput,
                fmt::format("there are {} tokens already; expected at most that", kMaxTokens));
  std::vector<Entry> entries = entries_;
  Entry& entry = entries.emplace_back();
  entry.view = TokenView{name, role, now_unix_ms};
  entry.sha256 = sha256_hex(*token);
  if (auto saved = save(entries); !saved) return tl::unexpected(saved.error());
  entries_ = std::move(entries);
  return token;
}

Result<void> TokenStore::revoke(const std::string& name) {
  if (name == kBootstrap) {
    return fail(ErrorKind::kInvalidInput,
                "the bootstrap token is the file 'token' of the state folder; remove it and start the "
                "coordinator anew");
  }
  const std::lock_guard lock(mutex_);
  std::vector<Entry> entries = entries_;
  if (std::erase_if(entries, [&](const Entry& entry) { return entry.view.name == name; }) == 0)
    return fail(ErrorKind::kUsage, fmt::format("no token is called '{}'; see photonfarm token list", name));
  if (auto saved = save(entries); !saved) return saved;
  entries_ = std::move(entries);
  return {};
}

}  // namespace pf
