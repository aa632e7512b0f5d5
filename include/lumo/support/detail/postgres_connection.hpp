#pragma once

// A session of a PostgreSQL server, by libpq (PostgreSQL licence).

#include "lumo/campaign/journal.hpp"
#include "lumo/support/process/process.hpp"

#if __has_include(<postgresql/libpq-fe.h>)
#include <postgresql/libpq-fe.h>
#else
#include <libpq-fe.h>
#endif

#include <poll.h>
#include <algorithm>
#include <cctype>
#include <charconv>
#include <initializer_list>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace lumo::detail {

/// Where a store is: a database as libpq's addresses name it, and a schema of it, `schema=…` among the parameters.
class PostgresAddress {
 public:
  /// Throws InvalidArgument, which does not repeat the address: a password may stand in it.
  explicit PostgresAddress(const std::string& address) {
    std::string rest;
    split_schema(address, rest);
    char* ignored = nullptr;
    const std::unique_ptr<PQconninfoOption, void (*)(PQconninfoOption*)> found(
        PQconninfoParse(rest.c_str(), &ignored), PQconninfoFree);
    PQfreemem(ignored);
    if (!found) refuse("libpq cannot read it");
    for (const PQconninfoOption* o = found.get(); o->keyword; ++o)
      if (o->val && *o->val) options_.emplace_back(o->keyword, o->val);
    // An '@' or '/' in a password that is not written %40 or %2F tears it apart.
    for (const char* keyword : {"user", "host", "port", "dbname"})
      if (value(keyword).find('@') != std::string::npos) refuse("an '@' in a name or password is written %40");
    const std::string port = value("port");
    if (!std::all_of(port.begin(), port.end(), [](char c) { return c == ',' || (c >= '0' && c <= '9'); }))
      refuse("its port is no number; a '/' in a password is written %2F");
    name_ = shown();
  }

  /// The same address without passwords: for messages, pages and records.
  const std::string& name() const { return name_; }
  const std::string& schema() const { return schema_; }
  std::string value(std::string_view keyword) const {
    for (const auto& [key, text] : options_)
      if (key == keyword) return text;
    return "";
  }

  /// A new session. A peer that does not answer is given up after seconds, unless the address says otherwise.
  PGconn* connect() const {
    std::vector<const char*> keys, values;
    const auto add = [&](const char* key, const char* text) {
      keys.push_back(key);
      values.push_back(text);
    };
    for (const auto& [key, text] : std::initializer_list<std::pair<const char*, const char*>>{{"connect_timeout", "10"},
             {"keepalives_idle", "5"}, {"keepalives_interval", "3"}, {"keepalives_count", "3"},
             {"tcp_user_timeout", "20000"}, {"fallback_application_name", "lumo"}})
      if (value(key).empty()) add(key, text);
    for (const auto& [key, text] : options_) add(key.c_str(), text.c_str());
    add("client_encoding", "UTF8");
    add(nullptr, nullptr);
    return PQconnectdbParams(keys.data(), values.data(), 0);
  }

 private:
  [[noreturn]] static void refuse(const std::string& why) {
    throw InvalidArgument("the store's address must be postgresql://[USER@]HOST[:PORT]/DATABASE[?schema=NAME]: " + why);
  }
  void split_schema(const std::string& address, std::string& rest) {
    const std::size_t query = address.find('?');
    rest = address.substr(0, query);
    if (query == std::string::npos) return;
    char separator = '?';
    for (std::size_t from = query + 1; from <= address.size();) {
      const std::size_t end = std::min(address.find('&', from), address.size());
      const std::string part = address.substr(from, end - from);
      if (part.starts_with("schema=")) schema_ = part.substr(std::string_view("schema=").size());
      else if (!part.empty()) rest += std::exchange(separator, '&') + part;
      from = end + 1;
    }
    const auto plain = [](char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_'; };
    if (schema_.empty() || schema_.size() > 63 || !std::all_of(schema_.begin(), schema_.end(), plain) ||
        (schema_[0] >= '0' && schema_[0] <= '9') || schema_.starts_with("pg_"))
      refuse(
          "a schema's name has lower-case letters, digits and '_', 63 at most, and starts with neither a digit nor "
          "pg_");
  }
  static std::string encoded(const std::string& text) {
    static constexpr char hex[] = "0123456789ABCDEF";
    std::string out;
    for (const char c : text) {
      const auto byte = static_cast<unsigned char>(c);
      if (std::isalnum(byte) || std::string_view("-._~,/").find(c) != std::string_view::npos) out += c;
      else (out += '%') += {hex[byte >> 4], hex[byte & 15]};
    }
    return out;
  }
  std::string shown() const {
    std::string text = "postgresql://", query;
    const std::string user = value("user"), host = value("host"), port = value("port"), database = value("dbname");
    if (!user.empty()) text += encoded(user) + '@';
    const bool folder = host.starts_with('/');  // of a socket
    if (!folder) text += host.find(':') == std::string::npos ? encoded(host) : '[' + host + ']';
    if (!folder && !port.empty()) text += ':' + port;
    text += '/' + encoded(database);
    const auto add = [&](const std::string& key, const std::string& s) {
      query += (query.empty() ? '?' : '&') + key + '=' + encoded(s);
    };
    if (folder) add("host", host);
    if (folder && !port.empty()) add("port", port);
    for (const auto& [key, s] : options_)
      if (!known_or_secret(key)) add(key, s);
    if (schema_ != "lumo") add("schema", schema_);
    return text + query;
  }
  static bool known_or_secret(const std::string& key) {
    for (const char* other : {"user", "host", "port", "dbname", "password", "sslpassword"})
      if (key == other) return true;
    return false;
  }

  std::vector<std::pair<std::string, std::string>> options_;
  std::string schema_ = "lumo", name_;
};

/// A message of the server or of libpq on one line.
inline std::string one_line_of(const char* text) {
  std::string line;
  for (const char c : std::string_view(text ? text : "")) {
    const bool space = c == ' ' || c == '\n' || c == '\t' || c == '\r';
    if (!space) line += c;
    else if (!line.empty() && line.back() != ' ') line += ' ';
  }
  while (!line.empty() && line.back() == ' ') line.pop_back();
  return line;
}

/// The session has ended: the server, the network or an administrator ended it.
class ConnectionLost : public Error {
 public:
  using Error::Error;
};

/// A bound parameter of a statement.
struct PostgresValue {
  std::string bytes;
  bool binary = false;

  PostgresValue(const std::string& text) : bytes(text) {}
  PostgresValue(const char* text) : bytes(text) {}
  PostgresValue(std::int64_t number) : bytes(std::to_string(number)) {}
  /// Of type bytea: any bytes.
  static PostgresValue raw(std::string bytes) {
    PostgresValue v(std::move(bytes));
    v.binary = true;
    return v;
  }
};

/// What a statement gave.
class PostgresRows {
 public:
  explicit PostgresRows(PGresult* result) : result_(result, PQclear) {}
  PGresult* get() const { return result_.get(); }
  int size() const { return PQntuples(result_.get()); }
  bool is_null(int row, int column) const { return PQgetisnull(result_.get(), row, column) != 0; }
  std::string text(int row, int column) const {
    return {PQgetvalue(result_.get(), row, column), std::size_t(PQgetlength(result_.get(), row, column))};
  }
  bool flag(int row, int column) const { return text(row, column) == "t"; }
  std::int64_t number(int row, int column) const {
    const std::string s = text(row, column);
    std::int64_t value = 0;
    std::from_chars(s.data(), s.data() + s.size(), value);
    return value;
  }
  /// Of a column of type bytea.
  std::string raw(int row, int column) const {
    std::size_t size = 0;
    const std::unique_ptr<unsigned char, void (*)(void*)> bytes(
        PQunescapeBytea(reinterpret_cast<const unsigned char*>(PQgetvalue(result_.get(), row, column)), &size),
        PQfreemem);
    if (!bytes) throw std::bad_alloc();
    return {reinterpret_cast<const char*>(bytes.get()), size};
  }

 private:
  std::unique_ptr<PGresult, decltype(&PQclear)> result_;
};

/// A session. It ends with this object, and with this process; its advisory locks then, too.
class PostgresConnection {
 public:
  /// Throws ConnectionLost with libpq's reason.
  explicit PostgresConnection(const PostgresAddress& address)
      : name_(address.name()), link_(address.connect(), PQfinish) {
    if (!link_) throw std::bad_alloc();
    if (PQstatus(link_.get()) != CONNECTION_OK) throw ConnectionLost(one_line_of(PQerrorMessage(link_.get())));
    PQsetNoticeProcessor(
        link_.get(), [](void*, const char*) {}, nullptr);
  }

  /// One statement with bound parameters $1, $2, … Throws ConnectionLost, or StoreError for what the server refuses.
  PostgresRows run(const char* sql, const std::vector<PostgresValue>& values = {}) const {
    std::vector<const char*> bytes;
    std::vector<int> sizes, formats;
    for (const PostgresValue& v : values) {
      bytes.push_back(v.bytes.data());
      sizes.push_back(int(v.bytes.size()));
      formats.push_back(v.binary);
    }
    PostgresRows rows(
        PQexecParams(link_.get(), sql, int(values.size()), nullptr, bytes.data(), sizes.data(), formats.data(), 0));
    const ExecStatusType status = PQresultStatus(rows.get());
    if (status != PGRES_COMMAND_OK && status != PGRES_TUPLES_OK) fail(rows);
    return rows;
  }

  int version() const { return PQserverVersion(link_.get()); }

  /// Waits until another session has notified `payload` on a channel that this one listens to, at most so long; false:
  /// the session has ended.
  bool wait(double seconds, const std::string& payload) const {
    const Deadline end(seconds);
    do {
      if (PQconsumeInput(link_.get()) == 0) return false;
      bool called = false;
      while (PGnotify* n = PQnotifies(link_.get())) {
        called = called || (n->extra == payload && n->be_pid != PQbackendPID(link_.get()));
        PQfreemem(n);
      }
      if (called) return true;
    } while (wait_ready(PQsocket(link_.get()), POLLIN, end) == Transfer::done);
    return true;
  }

 private:
  [[noreturn]] void fail(const PostgresRows& rows) const {
    const char* const field = PQresultErrorField(rows.get(), PG_DIAG_SQLSTATE);
    const std::string state = field ? field : "";
    const char* const said = PQresultErrorField(rows.get(), PG_DIAG_MESSAGE_PRIMARY);
    const std::string text = one_line_of(said ? said : PQerrorMessage(link_.get()));
    // What has no state is libpq's own error: it could not send, or not receive.
    if (state.empty() || PQstatus(link_.get()) != CONNECTION_OK || state.starts_with("08") || state.starts_with("57P"))
      throw ConnectionLost(text);
    using enum StoreError::Reason;
    const auto reason = state == "53100"                                                         ? full
                        : state == "55P03" || state.starts_with("40") || state.starts_with("53") ? busy
                        : state.starts_with("XX00")                                              ? corrupt
                                                                                                 : unusable;
    throw StoreError(reason, message("store ", name_, ": ", text));
  }

  std::string name_;
  std::unique_ptr<PGconn, decltype(&PQfinish)> link_;
};

}  // namespace lumo::detail
