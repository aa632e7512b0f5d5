#include "lumo/support/zip.hpp"

#include "version.hpp"

int main() {
  const lumo::ArchivedFile file{"a.txt", "a"};
  return lumo::Zip{}.pack({&file, 1}).starts_with("PK") && is_wanted_version() ? 0 : 1;
}
