#pragma once

// Adapter to SQLite (public domain) and, for digests, xxHash (BSD-2, header only). Link with -lsqlite3.

#include "lumo/campaign/journal.hpp"
#include "lumo/support/process/process.hpp"

#include <sqlite3.h>

#define XXH_INLINE_ALL
#include <xxhash.h>
#undef XXH_INLINE_ALL

#include <unistd.h>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <memory>

namespace lumo {

/// A campaign's journal in one SQLite file: durable (synchronous=FULL), safe under kill -9 and with several processes.
/// Each entry carries a digest that includes the one before, and the file says how many there are, because SQLite
/// itself does not notice a flipped bit. Every path is a file's, also ":memory:" and "file:x". What is found removed,
/// renamed or replaced at a write is kept beside with the entry to be written. Nothing that a file brings along is
/// carried out: it has three tables, and no triggers or views. All members throw StoreError. Not to be used after a
/// fork.
class SqliteJournal {
 public:
  /// Opens the file, or makes it with this problem when there is none. A file with another problem is refused with the
  /// first line that differs.
  SqliteJournal(const std::string& path, const std::string& problem);
  /// Opens a file that is there, for reading.
  explicit SqliteJournal(const std::string& path);

  /// All entries without their records. Each is read, and its digest checked, once.
  std::vector<JournalEntry> entries() const;
  std::string record(std::int64_t number) const;

  template <class Next> std::optional<JournalEntry> append(Next&& next);

  /// Takes over the work that an entry announces unless another living process on this machine has it.
  bool claim(std::int64_t number);

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
    explicit Transaction(const SqliteJournal& log) : log_(log) { log_.run("BEGIN IMMEDIATE"); }
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
    const SqliteJournal& log_;
    bool done_ = false;
  };

  static constexpr int application = 0x6c756d6f, format = 1;

  void open(int flags);
  void require_own_tables() const;
  /// Reads the entries that others, or append(), have added.
  void catch_up() const;
  bool moved() const;
  /// Copies the file, which is no longer at its path, beside it, with this entry; throws StoreError that says so.
  [[noreturn]] void rescue(const std::optional<JournalEntry>& entry) const;
  void create(const std::string& problem) const;
  void run(const char* sql) const { step(prepare(sql)); }
  Statement prepare(const char* sql) const;
  bool step(const Statement& s) const;  // true: a row
  [[noreturn]] void fail(int code) const;
  void insert(const JournalEntry& entry, const std::string& before) const;
  std::int64_t number_of(const char* sql) const;
  static std::string text(const Statement& s, int column);
  static void bind(const Statement& s, int place, const std::string& value) {
    sqlite3_bind_text(s.get(), place, value.data(), int(value.size()), SQLITE_TRANSIENT);
  }
  static std::string digest_of(const JournalEntry& entry, const std::string& before);

  std::string path_;
  pid_t owner_ = getpid();
  std::unique_ptr<sqlite3, Close> db_;
  mutable std::vector<JournalEntry> known_;
  mutable std::string known_digest_;
};

inline SqliteJournal::SqliteJournal(const std::string& path, const std::string& problem) : path_(path) {
  open(SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE);
  {
    Transaction t(*this);
    if (number_of("SELECT count(*) FROM sqlite_schema") == 0) create(problem);
    t.commit();
  }
  require_own_tables();
  const std::string stored = entries().front().content;
  if (stored == problem) return;
  const auto [a, b] = std::mismatch(stored.begin(), stored.end(), problem.begin(), problem.end());
  const auto line_of = [](const std::string& s, std::size_t at) {
    const std::size_t from = at == 0 ? 0 : s.rfind('\n', at - 1) + 1;
    std::string line = s.substr(from, s.find('\n', from) - from);
    line.erase(0, line.find_first_not_of(' '));
    if (line.ends_with(',')) line.pop_back();
    return line;
  };
  throw StoreError(StoreError::Reason::different,
      message("store ", path, " belongs to another problem: it has ", line_of(stored, std::size_t(a - stored.begin())),
          ", asked for is ", line_of(problem, std::size_t(b - problem.begin()))));
}

inline SqliteJournal::SqliteJournal(const std::string& path) : path_(path) {
  open(SQLITE_OPEN_READWRITE);  // a write that was cut off must be taken back first; a file that may not be written is
                                // opened for reading
  require_own_tables();
  entries();
}

inline void SqliteJournal::open(int flags) {
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

inline void SqliteJournal::create(const std::string& problem) const {
  run("CREATE TABLE entry(number INTEGER PRIMARY KEY, kind TEXT NOT NULL, content TEXT NOT NULL, record TEXT NOT NULL, "
      "notes TEXT NOT NULL, digest TEXT NOT NULL) STRICT");
  run("CREATE TABLE head(id INTEGER PRIMARY KEY CHECK (id = 0), number INTEGER NOT NULL, digest TEXT NOT NULL) STRICT");
  run("CREATE TABLE worker(number INTEGER PRIMARY KEY, process TEXT NOT NULL) STRICT");
  run(message("PRAGMA application_id=", application).c_str());
  run(message("PRAGMA user_version=", format).c_str());
  insert({0, JournalEntry::Kind::problem, problem, "", ""}, "");
}

inline void SqliteJournal::require_own_tables() const {
  const Statement s = prepare(
      "SELECT type, name FROM sqlite_schema WHERE type <> 'table' OR name NOT IN ('entry', 'head', 'worker') LIMIT 1");
  if (number_of("PRAGMA application_id") == application && step(s))
    throw StoreError(StoreError::Reason::corrupt, message("store ", path_, " has a ", printable(text(s, 0)), " '",
                                                      printable(text(s, 1)), "' that lumo has not made"));
}

inline std::vector<JournalEntry> SqliteJournal::entries() const {
  if (!known_.empty()) {
    catch_up();
    const Statement head = prepare("SELECT number, digest FROM head");
    if (step(head) && sqlite3_column_int64(head.get(), 0) == known_.back().number && text(head, 1) == known_digest_)
      return known_;
  }
  known_.clear();
  known_digest_.clear();
  if (number_of("PRAGMA application_id") != application)
    throw StoreError(StoreError::Reason::unusable, message(path_, " is not a store of lumo"));
  if (const auto v = number_of("PRAGMA user_version"); v != format)
    throw StoreError(StoreError::Reason::unusable,
        message("store ", path_, " has format ", v, ", this version of lumo reads ", format));
  catch_up();
  return known_;
}

inline void SqliteJournal::catch_up() const {
  std::vector<JournalEntry>& list = known_;
  bool whole = !list.empty();
  // One statement, so that entries and head are of one moment.
  const Statement s = prepare(
      "SELECT entry.number, kind, content, record, notes, entry.digest, head.number, head.digest FROM entry LEFT JOIN "
      "head ON id = 0 WHERE entry.number >= ? ORDER BY entry.number");
  sqlite3_bind_int64(s.get(), 1, list.empty() ? std::numeric_limits<std::int64_t>::min() : std::int64_t(list.size()));
  const auto next = [&] {
    try {
      return step(s);
    } catch (const StoreError& e) {  // SQLite itself found damage
      if (e.reason() != StoreError::Reason::corrupt) throw;
      throw StoreError(StoreError::Reason::corrupt,
          message("store ", path_, " is damaged at entry ", list.size(), ": ", sqlite3_errmsg(db_.get())));
    }
  };
  while (next()) {
    const auto kind = journal_kind(text(s, 1));
    JournalEntry e{sqlite3_column_int64(s.get(), 0), kind.value_or(JournalEntry::Kind::problem), text(s, 2), text(s, 3),
        text(s, 4)};
    const std::string found = text(s, 5);
    if (!kind || e.number != std::int64_t(list.size()) || digest_of(e, known_digest_) != found)
      throw StoreError(StoreError::Reason::corrupt, message("store ", path_, " is damaged at entry ", list.size()));
    known_digest_ = found;
    whole = sqlite3_column_int64(s.get(), 6) == e.number && text(s, 7) == found;
    e.record.clear();
    list.push_back(std::move(e));
  }
  if (!whole)
    throw StoreError(StoreError::Reason::corrupt,
        message("store ", path_, " is damaged after entry ", std::int64_t(list.size()) - 1, ": entries are missing"));
}

inline bool SqliteJournal::moved() const {
  int moved = 0;
  return sqlite3_file_control(db_.get(), "main", SQLITE_FCNTL_HAS_MOVED, &moved) == SQLITE_OK && moved != 0;
}

inline void SqliteJournal::rescue(const std::optional<JournalEntry>& entry) const {
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
    SqliteJournal kept(beside);
    if (entry) kept.append([&](const std::vector<JournalEntry>&) { return entry; });
    throw StoreError(StoreError::Reason::unusable, message(what, "; all that it held is in ", beside));
  }
  throw StoreError(StoreError::Reason::unusable, what);
}

inline std::string SqliteJournal::record(std::int64_t number) const {
  const Statement s = prepare("SELECT record FROM entry WHERE number = ?");
  sqlite3_bind_int64(s.get(), 1, number);
  if (!step(s)) throw StoreError(StoreError::Reason::corrupt, message("store ", path_, " has no entry ", number));
  return text(s, 0);
}

template <class Next> std::optional<JournalEntry> SqliteJournal::append(Next&& next) {
  if (moved()) rescue(next(entries()));
  Transaction t(*this);
  const std::vector<JournalEntry> list = entries();
  std::optional<JournalEntry> entry = next(list);
  if (!entry) return std::nullopt;
  entry->number = std::int64_t(list.size());
  insert(*entry, digest());
  t.commit();
  return entry;
}

inline bool SqliteJournal::claim(std::int64_t number) {
  const std::string me = process_token();
  if (moved()) rescue(std::nullopt);
  Transaction t(*this);
  const Statement now = prepare("SELECT process FROM worker WHERE number = ?");
  sqlite3_bind_int64(now.get(), 1, number);
  if (step(now))
    if (const std::string other = text(now, 0); other != me && process_lives(other)) return false;
  const Statement s = prepare("INSERT OR REPLACE INTO worker VALUES(?, ?)");
  sqlite3_bind_int64(s.get(), 1, number);
  bind(s, 2, me);
  step(s);
  t.commit();
  return true;
}

inline std::string SqliteJournal::digest() const {
  const Statement s = prepare("SELECT digest FROM head");
  return step(s) ? text(s, 0) : "";
}

inline std::string SqliteJournal::digest(std::int64_t number) const {
  const Statement s = prepare("SELECT digest FROM entry WHERE number = ?");
  sqlite3_bind_int64(s.get(), 1, number);
  if (!step(s)) throw StoreError(StoreError::Reason::corrupt, message("store ", path_, " has no entry ", number));
  return text(s, 0);
}

inline void SqliteJournal::verify() const {
  known_.clear();
  entries();
  const Statement s = prepare("PRAGMA integrity_check(1)");
  if (step(s))
    if (const std::string answer = text(s, 0); answer != "ok")
      throw StoreError(StoreError::Reason::corrupt, message("store ", path_, " is damaged: ", answer));
}

inline void SqliteJournal::insert(const JournalEntry& e, const std::string& before) const {
  const std::string digest = digest_of(e, before);
  const Statement s = prepare("INSERT INTO entry VALUES(?, ?, ?, ?, ?, ?)");
  sqlite3_bind_int64(s.get(), 1, e.number);
  bind(s, 2, to_string(e.kind));
  bind(s, 3, e.content);
  bind(s, 4, e.record);
  bind(s, 5, e.notes);
  bind(s, 6, digest);
  step(s);
  const Statement head = prepare("INSERT OR REPLACE INTO head VALUES(0, ?, ?)");
  sqlite3_bind_int64(head.get(), 1, e.number);
  bind(head, 2, digest);
  step(head);
}

inline SqliteJournal::Statement SqliteJournal::prepare(const char* sql) const {
  if (getpid() != owner_)
    throw StoreError(StoreError::Reason::unusable, message("store ", path_, " was opened before a fork"));
  sqlite3_stmt* s = nullptr;
  const int code = sqlite3_prepare_v2(db_.get(), sql, -1, &s, nullptr);
  Statement statement(s);
  if (code != SQLITE_OK) fail(code);
  return statement;
}

inline bool SqliteJournal::step(const Statement& s) const {
  const int code = sqlite3_step(s.get());
  if (code != SQLITE_ROW && code != SQLITE_DONE) fail(code);
  return code == SQLITE_ROW;
}

inline void SqliteJournal::fail(int code) const {
  using enum StoreError::Reason;
  const int kind = code & 0xff;
  const auto reason = kind == SQLITE_CORRUPT || kind == SQLITE_NOTADB || kind == SQLITE_ERROR ? corrupt
                      : kind == SQLITE_FULL                                                   ? full
                      : kind == SQLITE_BUSY || kind == SQLITE_LOCKED                          ? busy
                                                                                              : unusable;
  throw StoreError(reason, message("store ", path_, ": ", db_ ? sqlite3_errmsg(db_.get()) : sqlite3_errstr(code)));
}

inline std::int64_t SqliteJournal::number_of(const char* sql) const {
  const Statement s = prepare(sql);
  return step(s) ? sqlite3_column_int64(s.get(), 0) : 0;
}

inline std::string SqliteJournal::text(const Statement& s, int column) {
  const unsigned char* data = sqlite3_column_text(s.get(), column);
  return data ? std::string(reinterpret_cast<const char*>(data), std::size_t(sqlite3_column_bytes(s.get(), column)))
              : std::string();
}

inline std::string SqliteJournal::digest_of(const JournalEntry& e, const std::string& before) {
  std::string all = before;
  for (const std::string& part : {std::to_string(e.number), to_string(e.kind), e.content, e.record})
    all += std::to_string(part.size()) + ':' + part;
  const XXH128_hash_t h = XXH3_128bits(all.data(), all.size());
  char hex[33];
  std::snprintf(hex, sizeof hex, "%016llx%016llx", static_cast<unsigned long long>(h.high64),
      static_cast<unsigned long long>(h.low64));
  return hex;
}

static_assert(Journal<SqliteJournal>);

}  // namespace lumo
