#include "coordinator/http/tls.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <fmt/format.h>
#include <openssl/err.h>
#include <openssl/ssl.h>

#include "coordinator/config.h"

namespace pf {
namespace {

tl::unexpected<Error> tls_failure(const std::filesystem::path& file, std::string_view expected) {
  const unsigned long code = ERR_get_error();
  const char* reason = code != 0 ? ERR_reason_error_string(code) : nullptr;
  ERR_clear_error();
  return fail(ErrorKind::kUsage, fmt::format("{}: {}; expected {}", file.string(),
                                             reason != nullptr ? reason : "cannot be used", expected));
}

}  // namespace

void TlsContext::Free::operator()(::ssl_ctx_st* context) const { SSL_CTX_free(context); }

Result<std::unique_ptr<TlsContext>> TlsContext::load(const std::filesystem::path& certificate,
                                                     const std::filesystem::path& key) {
  if (auto mode = check_secret_mode(key); !mode) return tl::unexpected(mode.error());
  ERR_clear_error();
  std::unique_ptr<TlsContext> tls(new TlsContext);
  tls->context_.reset(SSL_CTX_new(TLS_server_method()));
  SSL_CTX* const context = tls->get();
  if (context == nullptr) return tls_failure(certificate, "memory for TLS");
  SSL_CTX_set_min_proto_version(context, TLS1_2_VERSION);
  SSL_CTX_set_options(context, SSL_OP_NO_COMPRESSION | SSL_OP_NO_RENEGOTIATION | SSL_OP_CIPHER_SERVER_PREFERENCE |
                                   SSL_OP_IGNORE_UNEXPECTED_EOF);
  SSL_CTX_set_mode(context,
                   SSL_MODE_ENABLE_PARTIAL_WRITE | SSL_MODE_ACCEPT_MOVING_WRITE_BUFFER | SSL_MODE_RELEASE_BUFFERS);
  if (SSL_CTX_use_certificate_chain_file(context, certificate.c_str()) != 1)
    return tls_failure(certificate, "a certificate in PEM, its chain after it");
  if (SSL_CTX_use_PrivateKey_file(context, key.c_str(), SSL_FILETYPE_PEM) != 1 ||
      SSL_CTX_check_private_key(context) != 1)
    return tls_failure(key, "the certificate's private key in PEM, without a passphrase");
  return tls;
}

bool is_loopback(const std::string& host) {
  if (host == "localhost") return true;
  ::in_addr v4{};
  if (::inet_pton(AF_INET, host.c_str(), &v4) == 1) return (ntohl(v4.s_addr) >> 24) == 127;
  ::in6_addr v6{};
  return ::inet_pton(AF_INET6, host.c_str(), &v6) == 1 && IN6_IS_ADDR_LOOPBACK(&v6);
}

}  // namespace pf
