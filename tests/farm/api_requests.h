#pragma once

#include <cstdint>
#include <map>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

namespace pf::farm_test {

/// A request as it goes over the wire, and what it was made from.
struct ApiRequest {
  std::string method, documented;  ///< of the document; the method may be one that it does not list
  std::string target;              ///< path and query
  std::vector<std::pair<std::string, std::string>> headers;
  std::string body;
  bool right = true;  ///< nothing was done to it

  [[nodiscard]] std::string text() const;
};

/// Requests made from an OpenAPI document: right ones, and wrong ones in whatever way the seed finds.
class ApiRequests {
 public:
  struct Operation {
    std::string method, path;
    nlohmann::json description;
  };

  ApiRequests(nlohmann::json document, std::uint64_t seed);

  /// What parameters and members of this name may well be; without, they are made from their schemas alone.
  void know(const std::string& name, std::vector<nlohmann::json> values) { known_[name] = std::move(values); }
  [[nodiscard]] const std::vector<Operation>& operations() const { return operations_; }
  [[nodiscard]] ApiRequest right(const Operation& operation);
  [[nodiscard]] ApiRequest wrong(const Operation& operation);

 private:
  [[nodiscard]] std::uint64_t below(std::uint64_t end) { return random_() % end; }
  [[nodiscard]] bool chance(double p) { return static_cast<double>(random_() >> 11) < p * 9007199254740992.0; }
  template <typename T>
  [[nodiscard]] const T& one_of(const std::vector<T>& choices) {
    return choices[below(choices.size())];
  }
  [[nodiscard]] nlohmann::json value_of(const nlohmann::json& given, const std::string& name);
  [[nodiscard]] nlohmann::json object_of(const nlohmann::json& schema);
  [[nodiscard]] std::string text_of(const nlohmann::json& value) const;
  [[nodiscard]] std::string bad_segment();
  [[nodiscard]] std::string bad_query_value();
  [[nodiscard]] nlohmann::json odd_value();
  /// Changes one place of a document.
  void spoil(nlohmann::json& document);
  void spoil_text(std::string& body);
  void spoil_path(ApiRequest& request, const Operation& operation);
  void spoil_query(ApiRequest& request);
  void spoil_headers(ApiRequest& request);
  void spoil_body(ApiRequest& request);

  const nlohmann::json document_;
  std::vector<Operation> operations_;
  std::map<std::string, std::vector<nlohmann::json>> known_;
  std::mt19937_64 random_;
};

}  // namespace pf::farm_test
