#include "jobs/farm_certificates.h"

#include <arpa/inet.h>
#include <openssl/bio.h>
#include <openssl/bn.h>
#include <openssl/ec.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>

#include <algorithm>
#include <array>
#include <memory>

#include <fmt/format.h>

namespace pf {
namespace {

constexpr long kTenYears = 3650L * 24 * 3600;
constexpr long kAnHour = 3600;  // clocks of other machines may be behind

template <auto Free>
struct Freer {
  template <typename T>
  void operator()(T* object) const {
    Free(object);
  }
};
using Key = std::unique_ptr<EVP_PKEY, Freer<EVP_PKEY_free>>;
using Certificate = std::unique_ptr<X509, Freer<X509_free>>;
using Extension = std::unique_ptr<X509_EXTENSION, Freer<X509_EXTENSION_free>>;
using Number = std::unique_ptr<BIGNUM, Freer<BN_free>>;
using Memory = std::unique_ptr<BIO, Freer<BIO_free_all>>;

tl::unexpected<Error> openssl_failure(std::string_view what) {
  std::array<char, 256> words{};
  ERR_error_string_n(ERR_get_error(), words.data(), words.size());
  return fail(ErrorKind::kInternal, fmt::format("{}: {}", what, words.data()));
}

/// As it stands in subjectAltName; empty for what is neither an address nor a host's name.
std::string alternative_name(const std::string& host) {
  std::array<unsigned char, sizeof(in6_addr)> address{};
  if (inet_pton(AF_INET, host.c_str(), address.data()) == 1 || inet_pton(AF_INET6, host.c_str(), address.data()) == 1) {
    // Both: the NATS client compares an address with names, others with addresses.
    return host.find(':') == std::string::npos ? fmt::format("IP:{0},DNS:{0}", host) : "IP:" + host;
  }
  const bool name = !host.empty() && host.size() <= 253 && std::all_of(host.begin(), host.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '.' ||
           c == '*';
  });
  return name ? "DNS:" + host : "";
}

bool add_extension(X509* certificate, X509* issuer, int id, const char* value) {
  X509V3_CTX context;
  X509V3_set_ctx(&context, issuer, certificate, nullptr, nullptr, 0);
  const Extension extension(X509V3_EXT_conf_nid(nullptr, &context, id, value));
  return extension != nullptr && X509_add_ext(certificate, extension.get(), -1) == 1;
}

/// Everything but the extensions and the signature.
Certificate begin_certificate(EVP_PKEY* key, const char* name, X509_NAME* issuer) {
  Certificate certificate(X509_new());
  const Number serial(BN_new());
  if (!certificate || !serial || BN_rand(serial.get(), 127, BN_RAND_TOP_ANY, BN_RAND_BOTTOM_ANY) != 1) return nullptr;
  X509* const x = certificate.get();
  X509_NAME* const subject = X509_get_subject_name(x);
  const bool made = X509_set_version(x, X509_VERSION_3) == 1 &&
                    BN_to_ASN1_INTEGER(serial.get(), X509_get_serialNumber(x)) != nullptr &&
                    X509_gmtime_adj(X509_getm_notBefore(x), -kAnHour) != nullptr &&
                    X509_gmtime_adj(X509_getm_notAfter(x), kTenYears) != nullptr &&
                    X509_NAME_add_entry_by_txt(subject, "CN", MBSTRING_ASC,
                                               reinterpret_cast<const unsigned char*>(name), -1, -1, 0) == 1 &&
                    X509_set_issuer_name(x, issuer == nullptr ? subject : issuer) == 1 && X509_set_pubkey(x, key) == 1;
  return made ? std::move(certificate) : nullptr;
}

Certificate make_authority(EVP_PKEY* key) {
  Certificate ca = begin_certificate(key, "photonfarm CA", nullptr);
  X509* const x = ca.get();
  const bool made = x != nullptr && add_extension(x, x, NID_basic_constraints, "critical,CA:TRUE,pathlen:0") &&
                    add_extension(x, x, NID_key_usage, "critical,keyCertSign,cRLSign") &&
                    add_extension(x, x, NID_subject_key_identifier, "hash") && X509_sign(x, key, EVP_sha256()) > 0;
  return made ? std::move(ca) : nullptr;
}

Certificate make_server(EVP_PKEY* key, X509* ca, EVP_PKEY* ca_key, const std::string& names) {
  Certificate server = begin_certificate(key, "photonfarm engine", X509_get_subject_name(ca));
  X509* const x = server.get();
  const bool made = x != nullptr && add_extension(x, ca, NID_basic_constraints, "critical,CA:FALSE") &&
                    add_extension(x, ca, NID_key_usage, "critical,digitalSignature") &&
                    add_extension(x, ca, NID_ext_key_usage, "serverAuth") &&
                    add_extension(x, ca, NID_subject_key_identifier, "hash") &&
                    add_extension(x, ca, NID_authority_key_identifier, "keyid") &&
                    add_extension(x, ca, NID_subject_alt_name, names.c_str()) && X509_sign(x, ca_key, EVP_sha256()) > 0;
  return made ? std::move(server) : nullptr;
}

std::string take_text(BIO* memory) {
  char* data = nullptr;
  const long size = BIO_get_mem_data(memory, &data);
  return {data, static_cast<std::size_t>(size)};
}

std::string pem(X509* certificate) {
  const Memory memory(BIO_new(BIO_s_mem()));
  return memory && PEM_write_bio_X509(memory.get(), certificate) == 1 ? take_text(memory.get()) : "";
}

std::string pem(EVP_PKEY* key) {
  const Memory memory(BIO_new(BIO_s_mem()));
  const bool written =
      memory && PEM_write_bio_PrivateKey(memory.get(), key, nullptr, nullptr, 0, nullptr, nullptr) == 1;
  return written ? take_text(memory.get()) : "";
}

}  // namespace

Result<Certificates> make_certificates(const std::vector<std::string>& hosts) {
  std::string names = "DNS:localhost,IP:127.0.0.1,DNS:127.0.0.1,IP:::1";
  for (const std::string& host : hosts) {
    const std::string name = alternative_name(host);
    if (name.empty()) {
      return fail(ErrorKind::kUsage, fmt::format("host '{}'; expected a host's name or address, without a port", host));
    }
    names += "," + name;
  }
  const Key ca_key(EVP_EC_gen("P-256"));
  const Key server_key(EVP_EC_gen("P-256"));
  if (!ca_key || !server_key) return openssl_failure("no key could be made");
  const Certificate ca = make_authority(ca_key.get());
  if (!ca) return openssl_failure("the CA certificate could not be made");
  const Certificate server = make_server(server_key.get(), ca.get(), ca_key.get(), names);
  if (!server) return openssl_failure("the server certificate could not be made");
  Certificates made{pem(ca.get()), pem(ca_key.get()), pem(server.get()), pem(server_key.get())};
  if (made.ca.empty() || made.ca_key.empty() || made.server.empty() || made.server_key.empty())
    return openssl_failure("certificates could not be written as PEM");
  return made;
}

}  // namespace pf
