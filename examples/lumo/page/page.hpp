#pragma once

/// The files of this folder, as the build puts them into the program (page.cpp.in).
namespace lumo::program::page {

extern const char* const document;  ///< with {{title}}, {{style}}, {{charts}}, {{data}} and {{script}} in it
extern const char* const style;
extern const char* const script;
extern const char* const solver_study;  ///< all above the first heading

}  // namespace lumo::program::page
