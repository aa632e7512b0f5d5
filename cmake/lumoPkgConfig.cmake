# Writes lumo.pc and lumo-<component>.pc for each component that is on, and installs them. They find their prefix from
# where they lie, so that an install tree may be moved, and they name no folder that the compiler searches by itself, so
# that they are the same for every architecture.
set(pc_dir ${CMAKE_INSTALL_DATADIR}/pkgconfig)
file(RELATIVE_PATH pc_prefix /prefix/${pc_dir} /prefix)
string(REGEX REPLACE "/$" "" pc_prefix ${pc_prefix})

# words: further lines of the file.
function(lumo_pkg_config name description words)
  file(CONFIGURE OUTPUT ${PROJECT_BINARY_DIR}/pkgconfig/${name}.pc @ONLY CONTENT
"prefix=\${pcfiledir}/@pc_prefix@
includedir=\${prefix}/${CMAKE_INSTALL_INCLUDEDIR}

Name: ${name}
Description: ${description}
Version: ${PROJECT_VERSION}
${words}
")
  install(FILES ${PROJECT_BINARY_DIR}/pkgconfig/${name}.pc DESTINATION ${pc_dir} COMPONENT headers)
endfunction()

# -I and -L, -l of a library without a .pc of its own.
function(lumo_flags_of out_cflags out_libs includes)
  set(cflags "")
  set(libs "")
  foreach(folder IN LISTS includes)
    if(NOT folder IN_LIST CMAKE_CXX_IMPLICIT_INCLUDE_DIRECTORIES)
      string(APPEND cflags " -I${folder}")
    endif()
  endforeach()
  foreach(library IN LISTS ARGN)
    get_filename_component(folder ${library} DIRECTORY)
    get_filename_component(name ${library} NAME_WE)
    string(REGEX REPLACE "^lib" "" name ${name})
    if(NOT folder IN_LIST CMAKE_CXX_IMPLICIT_LINK_DIRECTORIES)
      string(APPEND libs " -L${folder}")
    endif()
    string(APPEND libs " -l${name}")
  endforeach()
  set(${out_cflags} "Cflags:${cflags}" PARENT_SCOPE)
  set(${out_libs} "Libs:${libs}" PARENT_SCOPE)
endfunction()

# Of a component that is one folder and one library without a .pc of its own.
function(lumo_pkg_config_of name uses)
  if(TARGET lumo::${name})
    string(TOUPPER ${name} upper)
    lumo_flags_of(cflags libs "${LUMO_${upper}_INCLUDE}" ${LUMO_${upper}_LIBRARY})
    lumo_pkg_config(lumo-${name} "lumo with ${uses}" "Requires: lumo = ${PROJECT_VERSION}\n${cflags}\n${libs}")
  endif()
endfunction()

lumo_pkg_config(lumo "${PROJECT_DESCRIPTION} (headers, C++20)" "Requires: eigen3 >= 3.4\nCflags: -I\${includedir}")
lumo_pkg_config_of(tetgen "TetGen (AGPL-3+): tetrahedral meshes")
lumo_pkg_config_of(embree "Embree (Apache-2.0): rays")
if(TARGET lumo::cholmod)
  lumo_flags_of(cflags libs "${LUMO_CHOLMOD_INCLUDE}" ${LUMO_CHOLMOD_LIBRARY} ${LUMO_SUITESPARSECONFIG_LIBRARY})
  if(LUMO_OPENBLAS_LIBRARY)   # first, and although not every program calls it: see lumoComponents.cmake
    lumo_flags_of(unused blas "" ${LUMO_OPENBLAS_LIBRARY})
    string(REPLACE "Libs:" "" blas "${blas}")
    string(REPLACE "Libs:" "Libs: -Wl,--push-state,--no-as-needed${blas} -Wl,--pop-state" libs "${libs}")
  elseif(LUMO_BLAS_LIBRARY)
    lumo_flags_of(unused blas "" ${LUMO_BLAS_LIBRARY})
    string(REPLACE "Libs:" "" blas "${blas}")
    string(APPEND libs "${blas}")
  endif()
  lumo_pkg_config(lumo-cholmod "lumo with CHOLMOD (LGPL-2.1+, its supernodal part GPL-2+): sparse Cholesky factors"
    "Requires: lumo = ${PROJECT_VERSION}\n${cflags}\n${libs}")
endif()
if(TARGET lumo::tbb)
  lumo_pkg_config(lumo-tbb "lumo with oneTBB (Apache-2.0): threads"
    "Requires: lumo = ${PROJECT_VERSION}, tbb\nCflags: -pthread\nLibs: -pthread")
endif()
if(TARGET lumo::opencv)
  lumo_pkg_config(lumo-opencv "lumo with OpenCV (Apache-2.0): images, videos, cameras"
    "Requires: lumo = ${PROJECT_VERSION}, opencv4\nLibs: -Wl,--as-needed")
endif()
if(TARGET lumo::sqlite)
  lumo_flags_of(cflags libs "${LUMO_XXHASH_INCLUDE}")
  lumo_pkg_config(lumo-sqlite "lumo with SQLite (public domain) and xxHash (BSD-2-Clause): stores"
    "Requires: lumo = ${PROJECT_VERSION}, sqlite3\n${cflags}")
endif()
if(TARGET lumo::postgres)
  lumo_flags_of(cflags libs "${LUMO_POSTGRES_INCLUDE};${LUMO_XXHASH_INCLUDE}" ${LUMO_POSTGRES_LIBRARY})
  lumo_pkg_config(lumo-postgres "lumo with libpq (PostgreSQL) and xxHash (BSD-2-Clause): stores in a database"
    "Requires: lumo = ${PROJECT_VERSION}\n${cflags}\n${libs}")
endif()
lumo_pkg_config_of(zip "libzip (BSD-3-Clause): archives of printed parts")
lumo_pkg_config_of(lz4 "LZ4 (BSD-2-Clause): chunks of MCAP files")
lumo_pkg_config_of(zstd "Zstandard (BSD-3-Clause or GPL-2): chunks of MCAP files")
if(TARGET lumo::json)
  lumo_flags_of(cflags libs "${LUMO_JSON_INCLUDE}")
  lumo_pkg_config(lumo-json "lumo with nlohmann-json (MIT): logs" "Requires: lumo = ${PROJECT_VERSION}\n${cflags}")
endif()
