# cpack: two Debian packages, liblumo-dev (headers, for every architecture) and lumo-bin (the program).
find_program(LUMO_GZIP gzip)
if(NOT LUMO_GZIP)
  message(STATUS "cpack: off (gzip not found)")
  return()
endif()
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME lumo)
set(LUMO_MAINTAINER "the lumo authors <nobody@lumo.invalid>" CACHE STRING
  "Maintainer field of Debian packages: who answers for them, with an address")
set(CPACK_PACKAGE_CONTACT "${LUMO_MAINTAINER}")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES TRUE)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE
  WORLD_READ WORLD_EXECUTE)
set(CPACK_COMPONENTS_ALL headers)
set(CPACK_COMPONENT_HEADERS_DESCRIPTION "A header-only C++20 library: contact mechanics, light, objectives, Bayesian
optimisation and sensing for transparent finger pads that are lit from inside.
It needs Eigen; each other library has one header, and is suggested here.")
set(CPACK_DEBIAN_HEADERS_PACKAGE_NAME liblumo-dev)
set(CPACK_DEBIAN_HEADERS_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_HEADERS_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_HEADERS_PACKAGE_DEPENDS "libeigen3-dev (>= 3.4)")
set(suggests "")
foreach(component IN LISTS LUMO_COMPONENTS)
  string(REPLACE " " ";" packages "${LUMO_PACKAGE_${component}}")
  list(APPEND suggests ${packages})
endforeach()
list(APPEND suggests libopenblas-dev)
list(JOIN suggests ", " CPACK_DEBIAN_HEADERS_PACKAGE_SUGGESTS)

if(TARGET lumo_program)
  list(APPEND CPACK_COMPONENTS_ALL program)
  set(CPACK_COMPONENT_PROGRAM_DESCRIPTION "The command lumo: sections, meshes, presses, light,
objectives, searches that are kept in a store, reports, and logs of sensors.")
  set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME lumo-bin)
  set(CPACK_DEBIAN_PROGRAM_PACKAGE_SECTION science)
  set(CPACK_DEBIAN_PROGRAM_PACKAGE_SHLIBDEPS ON)
  set(CPACK_DEBIAN_PROGRAM_PACKAGE_RECOMMENDS python3-plotly)
  if(LUMO_NATIVE)   # only for machines like this one: the version says so
    set(CPACK_DEBIAN_PACKAGE_RELEASE 1+native)
  endif()
endif()

# What Debian wants beside the files: licences and changes.
file(READ ${PROJECT_SOURCE_DIR}/LICENSE licence)
string(REGEX REPLACE "^MIT License\n+Copyright [^\n]*\n+" "" licence "${licence}")
string(REGEX REPLACE "\n+$" "" licence "${licence}")
string(REPLACE "\n\n" "\n.\n" licence "${licence}")
string(REPLACE "\n" "\n " licence "${licence}")
set(package_dir ${PROJECT_BINARY_DIR}/package)
string(TIMESTAMP today "%a, %d %b %Y %H:%M:%S +0000" UTC)   # or SOURCE_DATE_EPOCH
file(WRITE ${package_dir}/changelog.Debian
  "lumo (${PROJECT_VERSION}-${CPACK_DEBIAN_PACKAGE_RELEASE}) unstable; urgency=low

  * What changed in lumo stands in changelog.gz.

 -- ${LUMO_MAINTAINER}  ${today}
")
foreach(pair IN ITEMS "${PROJECT_SOURCE_DIR}/CHANGELOG.md;changelog.gz"
  "${package_dir}/changelog.Debian;changelog.Debian.gz")
  list(GET pair 0 from)
  list(GET pair 1 to)
  execute_process(COMMAND ${LUMO_GZIP} -9nc INPUT_FILE ${from} OUTPUT_FILE ${package_dir}/${to} COMMAND_ERROR_IS_FATAL
    ANY)
endforeach()
foreach(component IN LISTS CPACK_COMPONENTS_ALL)
  string(TOUPPER ${component} upper)
  set(package ${CPACK_DEBIAN_${upper}_PACKAGE_NAME})
  configure_file(${PROJECT_SOURCE_DIR}/cmake/copyright.${component}.in ${package_dir}/${package}/copyright @ONLY)
  install(FILES ${package_dir}/${package}/copyright ${package_dir}/changelog.gz ${package_dir}/changelog.Debian.gz
          DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${package} COMPONENT ${component})
endforeach()
include(CPack)
