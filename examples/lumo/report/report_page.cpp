#include "report/report_page.hpp"

#include "page/page.hpp"

#include <map>
#include <string_view>

namespace lumo::program {

namespace {

void replace_all(std::string& text, std::string_view from, std::string_view to) {
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size()))
    text.replace(at, from.size(), to);
}

std::string as_text(std::string text) {
  replace_all(text, "&", "&amp;");
  replace_all(text, "<", "&lt;");
  return text;
}

/// In strings of a script, where alone these can stand, the backslash changes nothing.
std::string as_script(std::string text) {
  replace_all(text, "</script", "<\\/script");
  replace_all(text, "<!--", "<\\!--");
  return text;
}

std::string as_data(const Json& data) {
  std::string text = text_of(data, -1);
  replace_all(text, "<", "\\u003c");
  return text;
}

}  // namespace

std::string report_page(const std::string& title, const Json& data, const std::string& chart_library) {
  const std::map<std::string_view, std::string> parts = {{"title", as_text(title)}, {"style", page::style},
      {"charts", as_script(chart_library)}, {"data", as_data(data)}, {"script", page::script}};
  // Walks the template once, so that nothing is looked for in what was put in.
  std::string out;
  for (std::string_view rest = page::document;;) {
    const std::size_t open = rest.find("{{"), close = rest.find("}}", open);
    out += rest.substr(0, open);
    if (close == std::string_view::npos) return out;
    out += parts.at(rest.substr(open + 2, close - open - 2));
    rest.remove_prefix(close + 2);
  }
}

}  // namespace lumo::program
