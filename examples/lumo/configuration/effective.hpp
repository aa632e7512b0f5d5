#pragma once

#include "configuration/settings.hpp"

#include <functional>
#include <map>
#include <string>

/// A configuration as it comes about: layer over layer, each value with where it is from.
namespace lumo::program {

class Effective {
 public:
  Effective() = default;
  /// `defaults` of a command that has other ones.
  explicit Effective(const Configuration& defaults) : value_(defaults) {}

  const Configuration& value() const { return value_; }
  const Configuration* operator->() const { return &value_; }

  /// Sets what `flag`, an option, stands for. Throws UsageError.
  void type(const std::string& flag, const std::string& path, const std::string& typed);
  /// --set path=value. Throws UsageError.
  void set(const std::string& assignment);
  /// Applies a named assumption. Throws UsageError that names the nearest one.
  void assume(const std::string& name, const std::string& from);
  /// Applies a file. Throws InputError, whose text names file and key.
  void read(const std::string& file);
  /// The same of a text; `source` stands in messages.
  void read_text(const std::string& text, const std::string& source);

  /// Was this setting, or one of this group, given?
  bool gives(const std::string& group) const;

  /// Throws UsageError for a silicone that has a name of its own and lacks a number, InvalidArgument for values that do
  /// not go together, InfeasibleDesign.
  void check() const;

  /// A value, as it was given if it was.
  Json shown(const Setting& s) const;
  /// The whole, and under "from" where each value is from.
  Json dump() const;
  /// The whole without that, as results carry it.
  Json tree() const;

 private:
  void check_silicone() const;
  /// Refuses a file's name of an ensemble that is another.
  void check_ensemble(const Json& file) const;
  /// Marks what `change` changes. Throws UsageError where that takes back what --set has given.
  template <class Change> void layer(const std::string& from, const Change& change);
  void put_marked(const Setting& s, const Json& value, const std::string& from);

  Configuration value_;
  std::map<std::string, std::string> from_;  ///< path → source; absent: a default
  std::map<std::string, Json> given_;        ///< path → the value as it was given
};

/// A configuration as results carry it; only the groups that are named, if any are.
Json tree_of(const Configuration& configuration, const std::vector<std::string>& groups = {});
/// What tree_of() made. Throws Misfit, or UsageError for an unknown key.
Configuration configuration_of(const Json& tree);

/// Of all configuration files, as JSON Schema.
Json schema();

/// What --assume takes by name.
struct NamedAssumption {
  std::string name, words;
  std::function<void(Configuration&)> apply;
};
std::vector<NamedAssumption> named_assumptions();

}  // namespace lumo::program
