#pragma once

#include "lumo/core/error.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <istream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace lumo::sense {

/// Reads comma-separated tables strictly: one header line whose names carry their units, then rows of as many fields.
/// No quotes, no empty lines but at the end, no comments; fields may have spaces around them, lines may end in CR LF.
/// A header without commas is a spreadsheet's: semicolons or tabs separate, and numbers may have a decimal comma.
/// Every fault is an InputError of one line with file, line and column.
class CsvReader {
 public:
  static constexpr std::size_t max_line = 65536, max_columns = 256;

  /// Reads the header. `name` stands in messages.
  CsvReader(std::istream& in, std::string name) : in_(in), name_(std::move(name)) {
    if (!read_line()) throw InputError(message(name_, ": is empty, must begin with a line of column names"));
    if (line_text_.starts_with("\xef\xbb\xbf")) line_text_.erase(0, 3);
    if (line_text_.starts_with("sep=") && line_text_.size() == 5 && !read_line())  // a spreadsheet's line of its own
      throw InputError(message(name_, ":2: is empty, must be a line of column names"));
    for (const char separator : {'\t', ';', ','})
      if (line_text_.find(separator) != std::string::npos) separator_ = separator;
    split();
    for (const std::string_view f : fields_) {
      if (f.empty()) throw InputError(message(name_, ":1: column ", columns_.size() + 1, " has no name"));
      for (const std::string& c : columns_)
        if (c == f) throw InputError(message(name_, ":1: column '", printable(f), "' is there twice"));
      columns_.emplace_back(f);
    }
  }

  const std::vector<std::string>& columns() const { return columns_; }
  /// Place of a column, or −1.
  int find(std::string_view column) const {
    for (std::size_t i = 0; i < columns_.size(); ++i)
      if (columns_[i] == column) return int(i);
    return -1;
  }
  /// Place of a column that must be there.
  int require(std::string_view column) const {
    if (const int i = find(column); i >= 0) return i;
    throw InputError(message(name_, ":1: column '", printable(column), "' is missing"));
  }
  /// Throws for the first column that is none of those known.
  template <class Known> void require_known(Known known) const {
    for (const std::string& c : columns_)
      if (!known(std::string_view(c))) throw InputError(message(name_, ":1: column '", printable(c), "' is not known"));
  }

  /// Goes to the next row; false at the end of the file.
  bool next() {
    if (!read_line()) return false;
    if (line_text_.find_first_not_of(" \t") == std::string::npos) {
      while (read_line())
        if (line_text_.find_first_not_of(" \t") != std::string::npos)
          throw InputError(message(name_, ":", line_ - 1, ": is empty, only the end of the file may be"));
      return false;
    }
    split();
    if (fields_.size() != columns_.size())
      throw InputError(message(name_, ":", line_, ": has ", fields_.size(), " fields, the header ", columns_.size()));
    return true;
  }
  std::string_view text(int column) const { return fields_[std::size_t(column)]; }
  /// A finite number.
  double number(int column) const {
    std::string_view f = text(column);
    std::string with_point;
    if (const auto comma = f.find(','); separator_ != ',' && comma != std::string_view::npos) {
      with_point = f;
      with_point[comma] = '.';
      f = with_point;
    }
    double v = 0.0;
    const auto [end, error] = std::from_chars(f.data(), f.data() + f.size(), v);
    if (error != std::errc() || end != f.data() + f.size() || !std::isfinite(v)) fail(column, "is no finite number");
    return v;
  }
  /// Whether a field is empty or says that there is no number: nan, NaN, null.
  bool is_blank(int column) const {
    const std::string_view f = text(column);
    return f.empty() || f == "nan" || f == "NaN" || f == "NAN" || f == "-nan" || f == "null";
  }
  std::int64_t integer(int column) const {
    const std::string_view f = text(column);
    std::int64_t v = 0;
    const auto [end, error] = std::from_chars(f.data(), f.data() + f.size(), v);
    if (error != std::errc() || end != f.data() + f.size()) fail(column, "is no whole number of 64 bits");
    return v;
  }
  long line() const { return line_; }
  const std::string& name() const { return name_; }
  /// Throws the error of a field: file, line, column, text, reason.
  [[noreturn]] void fail(int column, std::string_view why) const {
    throw InputError(message(name_, ":", line_, ": column ", printable(columns_[std::size_t(column)]), ": '",
        printable(text(column)), "' ", why));
  }

 private:
  bool read_line() {
    line_text_.clear();
    ++line_;
    for (int c = in_.get(); c != std::istream::traits_type::eof(); c = in_.get()) {
      if (c == '\n') {
        if (line_text_.ends_with('\r')) line_text_.pop_back();
        return true;
      }
      if (c == '\0') {
        const bool wide = line_text_.starts_with("\xff\xfe") || line_text_.starts_with("\xfe\xff");
        throw InputError(
            message(name_, ":", line_, ": holds a zero byte, is ", wide ? "UTF-16 and not UTF-8" : "no text"));
      }
      line_text_ += char(c);
      if (line_text_.size() > max_line)
        throw InputError(message(name_, ":", line_, ": is longer than ", max_line, " bytes"));
    }
    if (in_.bad()) throw InputError(message(name_, ":", line_, ": cannot be read"));
    return !line_text_.empty();
  }

  void split() {
    fields_.clear();
    const std::string_view all = line_text_;
    if (const auto quote = all.find('"'); quote != std::string_view::npos)
      throw InputError(message(name_, ":", line_, ": holds a quote at byte ", quote + 1, ", fields are not quoted"));
    for (std::size_t from = 0;;) {
      const std::size_t to = std::min(all.find(separator_, from), all.size());
      std::string_view f = all.substr(from, to - from);
      while (!f.empty() && (f.front() == ' ' || f.front() == '\t')) f.remove_prefix(1);
      while (!f.empty() && (f.back() == ' ' || f.back() == '\t')) f.remove_suffix(1);
      fields_.push_back(f);
      if (fields_.size() > max_columns)
        throw InputError(message(name_, ":", line_, ": has more than ", max_columns, " fields"));
      if (to == all.size()) return;
      from = to + 1;
    }
  }

  std::istream& in_;
  std::string name_, line_text_;
  std::vector<std::string> columns_;
  std::vector<std::string_view> fields_;
  long line_ = 0;
  char separator_ = ',';
};

/// The shortest text that reads back as the same number. Throws InvalidArgument unless it is finite.
inline std::string csv_number(double v) {
  if (!std::isfinite(v)) throw InvalidArgument("a table's number must be finite");
  char buffer[32];
  const auto [end, error] = std::to_chars(buffer, buffer + sizeof buffer, v);
  return {buffer, end};
}

}  // namespace lumo::sense
