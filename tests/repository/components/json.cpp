#include "lumo/support/json.hpp"

#include "version.hpp"

int main() {
  lumo::sense::Session session;
  session.led_count = 7;
  return lumo::session_from_json(lumo::to_json(session), "session").led_count == 7 && is_wanted_version() ? 0 : 1;
}
