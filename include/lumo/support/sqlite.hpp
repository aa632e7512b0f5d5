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
#include <memory>

namespace lumo {

/// A campaign's journal in one SQLite file: durable (synchronous=FULL), safe under kill -9 and with several processes.
/// Each entry carries a digest that includes the one before, and the file says how many there are, because SQLite
/// itself does not notice a flipped bit. All members throw StoreError. Not to be used after a fork.
class SqliteJournal {
 public:
  /// Opens the file, or makes it with this problem when there is none. A file with another problem is refused with the
  /// first line that differs.
  SqliteJournal(const std::string& path, const std::string& problem);
  /// Opens a file that is there, for reading.
  explicit SqliteJournal(const std::string& path);

  /// All entries without their records; every digest is checked on the way.
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
};

inline SqliteJournal::SqliteJournal(const std::string& path, const std::string& problem) : path_(path) {
  open(SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE);
  {
    Transaction t(*this);
    if (number_of("SELECT count(*) FROM sqlite_schema") == 0) create(problem);
    t.commit();
  }
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
  entries();
}

inline void SqliteJournal::open(int flags) {
  sqlite3* db = nullptr;
  const int code = sqlite3_open_v2(path_.c_str(), &db, flags, nullptr);
  db_.reset(db);
  if (code != SQLITE_OK) fail(code);
  sqlite3_extended_result_codes(db, 1);
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

inline std::vector<JournalEntry> SqliteJournal::entries() const {
  if (number_of("PRAGMA application_id") != application)
    throw StoreError(StoreError::Reason::unusable, message(path_, " is not a store of lumo"));
  if (const auto v = number_of("PRAGMA user_version"); v != format)
    throw StoreError(StoreError::Reason::unusable,
        message("store ", path_, " has format ", v, ", this version of lumo reads ", format));
  std::vector<JournalEntry> list;
  std::string before;
  bool whole = false;
  // One statement, so that entries and head are of one moment.
  const Statement s = prepare(
      "SELECT entry.number, kind, content, record, notes, entry.digest, head.number, head.digest FROM entry LEFT JOIN "
      "head ON id = 0 ORDER BY entry.number");
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
    if (!kind || e.number != std::int64_t(list.size()) || digest_of(e, before) != found)
      throw StoreError(StoreError::Reason::corrupt, message("store ", path_, " is damaged at entry ", list.size()));
    before = found;
    whole = sqlite3_column_int64(s.get(), 6) == e.number && text(s, 7) == found;
    e.record.clear();
    list.push_back(std::move(e));
  }
  if (!whole)
    throw StoreError(StoreError::Reason::corrupt,
        message("store ", path_, " is damaged after entry ", std::int64_t(list.size()) - 1, ": entries are missing"));
  return list;
}

inline std::string SqliteJournal::record(std::int64_t number) const {
  const Statement s = prepare("SELECT record FROM entry WHERE number = ?");
  sqlite3_bind_int64(s.get(), 1, number);
  if (!step(s)) throw StoreError(StoreError::Reason::corrupt, message("store ", path_, " has no entry ", number));
  return text(s, 0);
}

template <class Next> std::optional<JournalEntry> SqliteJournal::append(Next&& next) {
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
