#include "coordinator/store/sqlite.h"

#include <sqlite3.h>

#include <cerrno>
#include <system_error>

#include <fmt/format.h>

namespace pf {
namespace {

constexpr int kBusyMilliseconds = 5000;  // a coordinator that is being stopped lets go within this

// Held by one process alone: then the log needs no shared memory, and a database can be opened on a full disk
// too. A commit reaches the disk before anybody is told of it (synchronous FULL): a client that has a job's
// id finds the job after a power cut. That is one fsync for each transition of a job; results come in between
// without any.
constexpr const char* kPragmas =
    "PRAGMA locking_mode=EXCLUSIVE; PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; PRAGMA "
    "foreign_keys=ON;";

ErrorKind kind_of(int code) {
  switch (code & 0xff) {
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return ErrorKind::kUnavailable;
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      return ErrorKind::kInvalidInput;
    default:
      return ErrorKind::kInternal;
  }
}

tl::unexpected<Error> error_of(sqlite3* database, const std::string& name) {
  const int code = sqlite3_extended_errcode(database);
  const ErrorKind kind = kind_of(code);
  std::string text = fmt::format("{}: {}", name, sqlite3_errmsg(database));
  const int system = (code & 0xff) == SQLITE_FULL ? ENOSPC : sqlite3_system_errno(database);
  if (kind == ErrorKind::kInternal && system != 0) text += fmt::format(": {}", std::generic_category().message(system));
  // SQLite does not always keep what the system said.
  if (kind == ErrorKind::kInternal && system == 0 && (code & 0xff) == SQLITE_IOERR)
    text += "; no space, or a limit on the size of files?";
  if (kind == ErrorKind::kUnavailable) text += "; another coordinator works on this folder";
  if (kind == ErrorKind::kInvalidInput) text += "; see photonfarm doctor --state";
  return fail(kind, std::move(text));
}

}  // namespace

void Statement::Finalize::operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
void Database::Close::operator()(sqlite3* database) const { sqlite3_close(database); }

Statement& Statement::bind(int index, std::int64_t value) {
  sqlite3_bind_int64(statement_.get(), index, value);
  return *this;
}
Statement& Statement::bind(int index, double value) {
  sqlite3_bind_double(statement_.get(), index, value);
  return *this;
}
Statement& Statement::bind(int index, std::string_view value) {
  sqlite3_bind_text64(statement_.get(), index, value.empty() ? "" : value.data(), value.size(), SQLITE_TRANSIENT,
                      SQLITE_UTF8);
  return *this;
}

tl::unexpected<Error> Statement::failure() const { return error_of(sqlite3_db_handle(statement_.get()), name_); }

Result<bool> Statement::step() {
  const int code = sqlite3_step(statement_.get());
  if (code == SQLITE_ROW) return true;
  if (code == SQLITE_DONE) return false;
  auto error = failure();
  reset();
  return error;
}

Result<void> Statement::run() {
  const auto row = step();
  reset();
  if (!row) return tl::unexpected(row.error());
  return {};
}

void Statement::reset() { sqlite3_reset(statement_.get()); }

std::int64_t Statement::integer(int column) const { return sqlite3_column_int64(statement_.get(), column); }
double Statement::real(int column) const { return sqlite3_column_double(statement_.get(), column); }
std::string Statement::text(int column) const {
  const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement_.get(), column));
  return text == nullptr ? std::string()
                         : std::string(text, static_cast<std::size_t>(sqlite3_column_bytes(statement_.get(), column)));
}

Result<Database> Database::open(const std::filesystem::path& file) {
  Database database;
  database.name_ = file.string();
  sqlite3* raw = nullptr;
  const int code =
      sqlite3_open_v2(file.c_str(), &raw, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX, nullptr);
  database.database_.reset(raw);
  if (raw == nullptr) return fail(ErrorKind::kInternal, fmt::format("{}: no memory for a database", database.name_));
  if (code != SQLITE_OK) return error_of(raw, database.name_);
  sqlite3_extended_result_codes(raw, 1);
  sqlite3_busy_timeout(raw, kBusyMilliseconds);
  if (auto set = database.execute(kPragmas); !set) return tl::unexpected(set.error());
  // Takes the lock now, not with the first change.
  if (auto version = database.number("PRAGMA user_version"); !version) return tl::unexpected(version.error());
  return database;
}

Result<Statement> Database::prepare(std::string_view sql) const {
  Statement statement;
  statement.name_ = name_;
  sqlite3_stmt* raw = nullptr;
  if (sqlite3_prepare_v2(database_.get(), sql.data(), static_cast<int>(sql.size()), &raw, nullptr) != SQLITE_OK) {
    return error_of(database_.get(), name_);
  }
  statement.statement_.reset(raw);
  return statement;
}

Result<void> Database::execute(const std::string& sql) const {
  if (sqlite3_exec(database_.get(), sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK)
    return error_of(database_.get(), name_);
  return {};
}

Result<std::int64_t> Database::number(std::string_view sql) const {
  auto statement = prepare(sql);
  if (!statement) return tl::unexpected(statement.error());
  const auto row = statement->step();
  if (!row) return tl::unexpected(row.error());
  if (!*row) return fail(ErrorKind::kInternal, fmt::format("{}: no row for: {}", name_, sql));
  return statement->integer(0);
}

Result<Database::Transaction> Database::Transaction::begin(const Database& database) {
  if (auto begun = database.execute("BEGIN IMMEDIATE"); !begun) return tl::unexpected(begun.error());
  return Transaction(database);
}

Result<void> Database::Transaction::commit() {
  if (auto committed = database_->execute("COMMIT"); !committed) return committed;  // the destructor undoes it
  database_ = nullptr;
  return {};
}

Database::Transaction::~Transaction() {
  if (database_ != nullptr) static_cast<void>(database_->execute("ROLLBACK"));
}

}  // namespace pf
