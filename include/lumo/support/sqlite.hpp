#pragma once

// Adapter to SQLite (public domain) and, for digests, xxHash (BSD-2, header only). Link with -lsqlite3.

#include "lumo/campaign/journal.hpp"
#include "lumo/support/detail/claim_locks.hpp"
#include "lumo/support/detail/entry_chain.hpp"
#include "lumo/support/process/process.hpp"

#include <sqlite3.h>

#include <unistd.h>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <system_error>
#include <utility>

namespace lumo {

/// A campaign's journal in one SQLite file: durable (synchronous=FULL), safe under kill -9 and with several processes.
/// A claim is a lock that the kernel frees when its worker dies, on a file `<store>.claims` that is there meanwhile.
/// Each entry carries a digest that includes the one before, and the file says how many there are, because SQLite
/// itself does not notice a flipped bit. Every path is a file's, also ":memory:" and "file:x". What is found removed,
/// renamed or replaced at a write is kept beside with the entry to be written. Nothing that a file brings along is
/// carried out: it has three tables, a fourth once an answer had to wait for its turn, and no triggers or views. All
/// members throw StoreError. Not to be used after a fork.
class SqliteStore {
 public:
  /// Opens the file, or makes it with this problem when there is none. A file with another problem is refused with the
  /// first line that differs.
  SqliteStore(const std::string& path, const std::string& problem);
  /// Opens a file that is there, for reading.
  explicit SqliteStore(const std::string& path);

  /// All entries without their records. Each is read, and its digest checked, once.
  std::vector<JournalEntry> entries() const;
  std::string record(std::int64_t number) const;

  template <class Next> std::optional<JournalEntry> append(Next&& next);

  /// Takes over the work that an entry announces unless another living worker has it: another store object.
  bool claim(std::int64_t number);
  /// Takes over the first of these entries that no other living worker has.
  std::optional<std::int64_t> claim_first(const std::vector<std::int64_t>& numbers);
  /// Gives back what this one has claimed.
  void release(std::int64_t number);
  /// Of living workers; a file keeps no times.
  std::vector<Claim> claims() const;

  /// Keeps the answer to the entry `number` beside the entries until one like it is appended; false if there is one.
  bool deliver(std::int64_t number, const JournalEntry& answer);
  std::vector<std::int64_t> delivered() const;
  std::optional<JournalEntry> delivery(std::int64_t number) const;
  void wait(double seconds) { pause_for(seconds); }

  /// Digest of the last entry: of the whole journal.
  std::string digest() const;
  /// Of an entry and those before it; of entry 0: of the problem.
  std::string digest(std::int64_t number) const;
  /// SQLite's own check of the file beside the digests. Throws StoreError that names the first bad entry.
  void verify() const;

 private:
  struct Close {
    void operator()(sqlite3* db) const { sqlite3_close_v2(db); }
  };
  struct Finalize {
    void operator()(sqlite3_stmt* s) const { sqlite3_finalize(s); }
  };
  using Statement = std::unique_ptr<sqlite3_stmt, Finalize>;

  // Rolls back unless committed.
  class Transaction {
   public:
    explicit Transaction(const SqliteStore& log) : log_(log) { log_.run("BEGIN IMMEDIATE"); }
    ~Transaction() {
      if (!done_) sqlite3_exec(log_.db_.get(), "ROLLBACK", nullptr, nullptr, nullptr);
    }
    Transaction(const Transaction&) = delete;
    Transaction& operator=(const Transaction&) = delete;
    void commit() {
      log_.run("COMMIT");
      done_ = true;
    }

   private:
    const SqliteStore& log_;
    bool done_ = false;
  };

  static constexpr int application = 0x6c756d6f, format = 1;

  void open(int flags);
  void require_own_tables() const;
  void require_owner() const;
  /// Makes `known_` what the file holds: reads what was added, or all of a file that is another.
  void bring_up_to_date() const;
  /// Reads the entries that others, or append(), have added.
  void catch_up() const;
  bool moved() const;
  /// Copies the file, which is no longer at its path, beside it, with what `add(copy)` adds; throws StoreError that
  /// says so.
  [[noreturn]] void rescue(const std::function<void(SqliteStore&)>& add) const;
  void create(const std::string& problem) const;
  void run(const char* sql) const { step(prepare(sql)); }
  Statement prepare(const char* sql) const;
  bool step(const Statement& s) const;  // true: a row
  [[noreturn]] void fail(int code) const;
  void insert(const JournalEntry& entry, const std::string& before) const;
  std::int64_t number_of(const char* sql) const;
  static std::string text(const Statement& s, int column);
  static detail::StoredEntry stored(const Statement& s);
  static void bind(const Statement& s, int place, const std::string& value) {
    sqlite3_bind_text(s.get(), place, value.data(), int(value.size()), SQLITE_TRANSIENT);
  }
  static void bind_entry(const Statement& s, const JournalEntry& e, const std::string& digest) {
    sqlite3_bind_int64(s.get(), 1, e.number);
    int place = 1;
    for (const std::string& value : {to_string(e.kind), e.content, e.record, e.notes, digest}) bind(s, ++place, value);
  }
  static std::string beside(const std::string& path) {
    std::error_code none;
    return std::filesystem::absolute(path, none).string() + ".claims";
  }
  bool has_deliveries() const { return number_of("SELECT count(*) FROM sqlite_schema WHERE name = 'delivery'") != 0; }

  std::string path_;
  detail::ClaimLocks locks_{beside(path_)};
  pid_t owner_ = getpid();
  std::unique_ptr<sqlite3, Close> db_;
  mutable detail::EntryChain known_;
};

/// Its name in earlier versions.
using SqliteJournal = SqliteStore;

inline SqliteStore::SqliteStore(const std::string& path, const std::string& problem) : path_(path) {
  open(SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE);
  {
    Transaction t(*this);
    if (number_of("SELECT count(*) FROM sqlite_schema") == 0) create(problem);
    t.commit();
  }
  require_own_tables();
  detail::require_problem(path, entries().front().content, problem);
}

inline SqliteStore::SqliteStore(const std::string& path) : path_(path) {
  open(SQLITE_OPEN_READWRITE);  // a write that was cut off must be taken back first; a file that may not be written is
                                // opened for reading
  require_own_tables();
  entries();
}

inline void SqliteStore::open(int flags) {
  if (path_.empty()) throw StoreError(StoreError::Reason::unusable, "store has no name");
  sqlite3* db = nullptr;
  // An absolute path is neither SQLite's ":memory:" nor a URI.
  const int code = sqlite3_open_v2(std::filesystem::absolute(path_).c_str(), &db, flags, nullptr);
  db_.reset(db);
  if (code != SQLITE_OK) fail(code);
  sqlite3_extended_result_codes(db, 1);
  for (const int option : {SQLITE_DBCONFIG_ENABLE_TRIGGER, SQLITE_DBCONFIG_ENABLE_VIEW, SQLITE_DBCONFIG_TRUSTED_SCHEMA})
    sqlite3_db_config(db, option, 0, nullptr);
  if (flags & SQLITE_OPEN_CREATE) sqlite3_db_config(db, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
  sqlite3_busy_timeout(db, 60'000);
  // Readers get as far as a file that was cut short goes, so that the first lost entry can be named.
  if (!(flags & SQLITE_OPEN_CREATE)) run("PRAGMA writable_schema=ON");
  run("PRAGMA synchronous=FULL");
  run("PRAGMA cell_size_check=ON");
}

inline void SqliteStore::create(const std::string& problem) const {
  run("CREATE TABLE entry(number INTEGER PRIMARY KEY, kind TEXT NOT NULL, content TEXT NOT NULL, record TEXT NOT NULL, "
      "notes TEXT NOT NULL, digest TEXT NOT NULL) STRICT");
  run("CREATE TABLE head(id INTEGER PRIMARY KEY CHECK (id = 0), number INTEGER NOT NULL, digest TEXT NOT NULL) STRICT");
  run("CREATE TABLE worker(number INTEGER PRIMARY KEY, process TEXT NOT NULL) STRICT");
  run(message("PRAGMA application_id=", application).c_str());
  run(message("PRAGMA user_version=", format).c_str());
  insert({0, JournalEntry::Kind::problem, problem, "", ""}, "");
}

inline void SqliteStore::require_own_tables() const {
  const Statement s = prepare(
      "SELECT type, name FROM sqlite_schema WHERE type <> 'table' OR name NOT IN ('entry', 'head', 'worker', "
      "'delivery') LIMIT 1");
  if (number_of("PRAGMA application_id") == application && step(s))
    throw StoreError(StoreError::Reason::corrupt, message("store ", path_, " has a ", printable(text(s, 0)), " '",
                                                      printable(text(s, 1)), "' that lumo has not made"));
}

inline std::vector<JournalEntry> SqliteStore::entries() const {
  bring_up_to_date();
  return known_.entries;
}

inline void SqliteStore::bring_up_to_date() const {
  if (!known_.entries.empty()) {
    catch_up();
    const Statement head = prepare("SELECT number, digest FROM head");
    if (step(head) && sqlite3_column_int64(head.get(), 0) == known_.entries.back().number &&
        text(head, 1) == known_.digest)
      return;
  }
  known_ = {};
  if (number_of("PRAGMA application_id") != application)
    throw StoreError(StoreError::Reason::unusable, message(path_, " is not a store of lumo"));
  if (const auto v = number_of("PRAGMA user_version"); v != format)
    throw StoreError(StoreError::Reason::unusable,
        message("store ", path_, " has format ", v, ", this version of lumo reads ", format));
  catch_up();
}

inline void SqliteStore::catch_up() const {
  const std::size_t before = known_.entries.size();
  // One statement, so that entries and head are of one moment.
  const Statement s = prepare(
      "SELECT entry.number, kind, content, record, notes, entry.digest, head.number, head.digest FROM entry LEFT JOIN "
      "head ON id = 0 WHERE entry.number >= ? ORDER BY entry.number");
  sqlite3_bind_int64(s.get(), 1, before == 0 ? std::numeric_limits<std::int64_t>::min() : std::int64_t(before));
  const auto next = [&] {
    try {
      return step(s);
    } catch (const StoreError& e) {  // SQLite itself found damage
      if (e.reason() != StoreError::Reason::corrupt) throw;
      throw StoreError(StoreError::Reason::corrupt,
          message("store ", path_, " is damaged at entry ", known_.entries.size(), ": ", sqlite3_errmsg(db_.get())));
    }
  };
  std::int64_t number = -1;
  std::string digest;
  while (next()) {
    known_.add(path_, stored(s));
    number = sqlite3_column_int64(s.get(), 6);
    digest = text(s, 7);
  }
  if (before == 0 || known_.entries.size() > before) known_.require_end(path_, number, digest);
}

inline detail::StoredEntry SqliteStore::stored(const Statement& s) {
  JournalEntry e;
  e.number = sqlite3_column_int64(s.get(), 0);
  e.content = text(s, 2);
  e.record = text(s, 3);
  e.notes = text(s, 4);
  return {text(s, 1), std::move(e), text(s, 5)};
}

inline bool SqliteStore::moved() const {
  int moved = 0;
  return sqlite3_file_control(db_.get(), "main", SQLITE_FCNTL_HAS_MOVED, &moved) == SQLITE_OK && moved != 0;
}

inline void SqliteStore::rescue(const std::function<void(SqliteStore&)>& add) const {
  const std::string what = message("store ", path_, " was ",
      std::filesystem::exists(path_) ? "replaced" : "removed or renamed", " while it was in use");
  for (int k = 1; k < 1000; ++k) {
    const std::string beside = message(path_, ".rescued-", k);
    if (std::filesystem::exists(beside)) continue;
    sqlite3* copy = nullptr;
    const int opened = sqlite3_open_v2(
        std::filesystem::absolute(beside).c_str(), &copy, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, nullptr);
    const std::unique_ptr<sqlite3, Close> closes(copy);
    sqlite3_backup* backup = opened == SQLITE_OK ? sqlite3_backup_init(copy, "main", db_.get(), "main") : nullptr;
    if (backup) sqlite3_backup_step(backup, -1);
    if (!backup || sqlite3_backup_finish(backup) != SQLITE_OK)
      throw StoreError(StoreError::Reason::unusable, message(what, ", and ", beside, " cannot be written"));
    SqliteStore kept(beside);
    add(kept);
    throw StoreError(StoreError::Reason::unusable, message(what, "; all that it held is in ", beside));
  }
  throw StoreError(StoreError::Reason::unusable, what);
}

inline std::string SqliteStore::record(std::int64_t number) const {
  const Statement s = prepare("SELECT record FROM entry WHERE number = ?");
  sqlite3_bind_int64(s.get(), 1, number);
  if (!step(s)) throw StoreError(StoreError::Reason::corrupt, message("store ", path_, " has no entry ", number));
  return text(s, 0);
}

template <class Next> std::optional<JournalEntry> SqliteStore::append(Next&& next) {
  if (moved()) {
    // Not a lambda in append(): each would make another append().
    const std::function<std::optional<JournalEntry>(const std::vector<JournalEntry>&)> same =
        [entry = next(entries())](const auto&) { return entry; };
    rescue([&](SqliteStore& copy) { copy.append(same); });
  }
  Transaction t(*this);
  bring_up_to_date();
  std::optional<JournalEntry> entry = next(std::as_const(known_.entries));
  if (!entry) return std::nullopt;
  entry->number = std::int64_t(known_.entries.size());
  insert(*entry, known_.digest);
  if (has_deliveries()) {
    const Statement s = prepare("DELETE FROM delivery WHERE kind = ? AND content = ?");
    bind(s, 1, to_string(entry->kind));
    bind(s, 2, entry->content);
    step(s);
  }
  t.commit();
  return entry;
}

inline bool SqliteStore::claim(std::int64_t number) {
  require_owner();
  const std::string me = process_token();
  if (moved()) rescue([](SqliteStore&) {});
  const bool had = locks_.has(number);
  if (!had && !locks_.take(number)) return false;
  Transaction t(*this);
  const Statement now = prepare("SELECT process FROM worker WHERE number = ?");
  sqlite3_bind_int64(now.get(), 1, number);
  if (step(now))  // a process of an earlier version has no locks
    if (const std::string other = text(now, 0); other != me && process_lives(other)) {
      if (!had) locks_.give_back(number);
      return false;
    }
  const Statement s = prepare("INSERT OR REPLACE INTO worker VALUES(?, ?)");
  sqlite3_bind_int64(s.get(), 1, number);
  bind(s, 2, me);
  step(s);
  t.commit();
  return true;
}

inline std::optional<std::int64_t> SqliteStore::claim_first(const std::vector<std::int64_t>& numbers) {
  for (const std::int64_t number : numbers)
    if (claim(number)) return number;
  return std::nullopt;
}

inline void SqliteStore::release(std::int64_t number) {
  const Statement s = prepare("DELETE FROM worker WHERE number = ? AND process = ?");
  sqlite3_bind_int64(s.get(), 1, number);
  bind(s, 2, process_token());
  step(s);
  locks_.give_back(number);
}

inline std::vector<Claim> SqliteStore::claims() const {
  std::vector<Claim> list;
  const Statement s = prepare("SELECT number, process FROM worker ORDER BY number");
  while (step(s))
    if (const std::string process = text(s, 1);
        locks_.taken(sqlite3_column_int64(s.get(), 0)) || process_lives(process)) {
      const std::size_t from = process.find(' ') + 1;
      list.push_back({sqlite3_column_int64(s.get(), 0), "this machine", process.substr(from, process.rfind(' ') - from),
          std::nullopt});
    }
  return list;
}

inline bool SqliteStore::deliver(std::int64_t number, const JournalEntry& answer) {
  if (moved()) rescue([&](SqliteStore& copy) { copy.deliver(number, answer); });
  Transaction t(*this);
  bring_up_to_date();
  if (std::any_of(known_.entries.begin(), known_.entries.end(),
          [&](const JournalEntry& e) { return e.kind == answer.kind && e.content == answer.content; }))
    return false;
  run("CREATE TABLE IF NOT EXISTS delivery(number INTEGER PRIMARY KEY, kind TEXT NOT NULL, content TEXT NOT NULL, "
      "record TEXT NOT NULL, notes TEXT NOT NULL, digest TEXT NOT NULL) STRICT");
  JournalEntry e = answer;
  e.number = number;
  const Statement s = prepare("INSERT OR IGNORE INTO delivery VALUES(?, ?, ?, ?, ?, ?)");
  bind_entry(s, e, detail::entry_digest(e, ""));
  step(s);
  const bool added = sqlite3_changes(db_.get()) != 0;
  t.commit();
  return added;
}

inline std::vector<std::int64_t> SqliteStore::delivered() const {
  std::vector<std::int64_t> numbers;
  if (!has_deliveries()) return numbers;
  const Statement s = prepare("SELECT number FROM delivery ORDER BY number");
  while (step(s)) numbers.push_back(sqlite3_column_int64(s.get(), 0));
  return numbers;
}

inline std::optional<JournalEntry> SqliteStore::delivery(std::int64_t number) const {
  if (!has_deliveries()) return std::nullopt;
  const Statement s = prepare("SELECT number, kind, content, record, notes, digest FROM delivery WHERE number = ?");
  sqlite3_bind_int64(s.get(), 1, number);
  return step(s) ? std::optional(detail::checked_delivery(path_, stored(s))) : std::nullopt;
}

inline std::string SqliteStore::digest() const {
  const Statement s = prepare("SELECT digest FROM head");
  return step(s) ? text(s, 0) : "";
}

inline std::string SqliteStore::digest(std::int64_t number) const {
  const Statement s = prepare("SELECT digest FROM entry WHERE number = ?");
  sqlite3_bind_int64(s.get(), 1, number);
  if (!step(s)) throw StoreError(StoreError::Reason::corrupt, message("store ", path_, " has no entry ", number));
  return text(s, 0);
}

inline void SqliteStore::verify() const {
  known_ = {};
  entries();
  for (const std::int64_t number : delivered()) delivery(number);
  const Statement s = prepare("PRAGMA integrity_check(1)");
  if (step(s))
    if (const std::string answer = text(s, 0); answer != "ok")
      throw StoreError(StoreError::Reason::corrupt, message("store ", path_, " is damaged: ", answer));
}

inline void SqliteStore::insert(const JournalEntry& e, const std::string& before) const {
  const std::string digest = detail::entry_digest(e, before);
  const Statement s = prepare("INSERT INTO entry VALUES(?, ?, ?, ?, ?, ?)");
  bind_entry(s, e, digest);
  step(s);
  const Statement head = prepare("INSERT OR REPLACE INTO head VALUES(0, ?, ?)");
  sqlite3_bind_int64(head.get(), 1, e.number);
  bind(head, 2, digest);
  step(head);
}

inline void SqliteStore::require_owner() const {
  if (getpid() != owner_)
    throw StoreError(StoreError::Reason::unusable, message("store ", path_, " was opened before a fork"));
}

inline SqliteStore::Statement SqliteStore::prepare(const char* sql) const {
  require_owner();
  sqlite3_stmt* s = nullptr;
  const int code = sqlite3_prepare_v2(db_.get(), sql, -1, &s, nullptr);
  Statement statement(s);
  if (code != SQLITE_OK) fail(code);
  return statement;
}

inline bool SqliteStore::step(const Statement& s) const {
  const int code = sqlite3_step(s.get());
  if (code != SQLITE_ROW && code != SQLITE_DONE) fail(code);
  return code == SQLITE_ROW;
}

inline void SqliteStore::fail(int code) const {
  using enum StoreError::Reason;
  const int kind = code & 0xff;
  const auto reason = kind == SQLITE_CORRUPT || kind == SQLITE_NOTADB || kind == SQLITE_ERROR ? corrupt
                      : kind == SQLITE_FULL                                                   ? full
                      : kind == SQLITE_BUSY || kind == SQLITE_LOCKED                          ? busy
                                                                                              : unusable;
  throw StoreError(reason, message("store ", path_, ": ", db_ ? sqlite3_errmsg(db_.get()) : sqlite3_errstr(code)));
}

inline std::int64_t SqliteStore::number_of(const char* sql) const {
  const Statement s = prepare(sql);
  return step(s) ? sqlite3_column_int64(s.get(), 0) : 0;
}

inline std::string SqliteStore::text(const Statement& s, int column) {
  const unsigned char* data = sqlite3_column_text(s.get(), column);
  return data ? std::string(reinterpret_cast<const char*>(data), std::size_t(sqlite3_column_bytes(s.get(), column)))
              : std::string();
}

static_assert(Store<SqliteStore>);

}  // namespace lumo
