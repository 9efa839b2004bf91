#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>

#include "common/base/result.h"

struct sqlite3;
struct sqlite3_stmt;

namespace pf {

/// A prepared statement; reset() makes it ready for another run. Parameters and columns count from 1 and 0, as in
/// SQLite.
class Statement {
 public:
  Statement& bind(int index, std::int64_t value);
  Statement& bind(int index, double value);
  Statement& bind(int index, std::string_view value);
  /// Binds all, from parameter 1 on. Unsigned numbers must be below 2^63.
  template <typename... Values>
  Statement& bind_all(const Values&... values) {
    int index = 0;
    (bind_one(++index, values), ...);
    return *this;
  }
  /// True while there is a row.
  [[nodiscard]] Result<bool> step();
  /// For statements without rows; then it is ready again.
  [[nodiscard]] Result<void> run();
  void reset();

  [[nodiscard]] std::int64_t integer(int column) const;
  [[nodiscard]] std::uint64_t count(int column) const { return static_cast<std::uint64_t>(integer(column)); }
  [[nodiscard]] double real(int column) const;
  [[nodiscard]] std::string text(int column) const;

 private:
  friend class Database;
  struct Finalize {
    void operator()(sqlite3_stmt* statement) const;
  };
  template <typename Value>
  void bind_one(int index, const Value& value) {
    if constexpr (std::is_floating_point_v<Value>) {
      bind(index, static_cast<double>(value));
    } else if constexpr (std::is_integral_v<Value>) {
      bind(index, static_cast<std::int64_t>(value));
    } else {
      bind(index, std::string_view(value));
    }
  }
  [[nodiscard]] tl::unexpected<Error> failure() const;
  std::unique_ptr<sqlite3_stmt, Finalize> statement_;
  std::string name_;  ///< of the database's file
};

/// A database of SQLite, held by this process alone. Errors name the file: kInvalidInput when it is damaged or no
/// database, kUnavailable when another process holds it, kInternal for the disk.
class Database {
 public:
  [[nodiscard]] static Result<Database> open(const std::filesystem::path& file);

  [[nodiscard]] Result<Statement> prepare(std::string_view sql) const;
  /// Any number of statements without parameters and rows.
  [[nodiscard]] Result<void> execute(const std::string& sql) const;
  /// The first column of the first row.
  [[nodiscard]] Result<std::int64_t> number(std::string_view sql) const;
  [[nodiscard]] const std::string& name() const { return name_; }

  /// Undoes everything since it was begun unless it is committed.
  class Transaction {
   public:
    [[nodiscard]] static Result<Transaction> begin(const Database& database);
    Transaction(Transaction&& other) noexcept : database_(std::exchange(other.database_, nullptr)) {}
    Transaction& operator=(Transaction&&) = delete;
    ~Transaction();
    [[nodiscard]] Result<void> commit();

   private:
    explicit Transaction(const Database& database) : database_(&database) {}
    const Database* database_;
  };

 private:
  struct Close {
    void operator()(sqlite3* database) const;
  };
  std::unique_ptr<sqlite3, Close> database_;
  std::string name_;
};

}  // namespace pf
