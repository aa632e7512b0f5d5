# Writes lumo.pc and lumo-<component>.pc for each component that is on, and installs them. They find their prefix from where they lie, so that an
# install tree may be moved, and they name no folder that the compiler searches by itself, so that they are the same for every architecture.
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

lumo_pkg_config(lumo "${PROJECT_DESCRIPTION} (headers, C++20)" "Requires: eigen3 >= 3.4\nCflags: -I\${includedir}")
if(TARGET lumo::tetgen)
  lumo_flags_of(cflags libs "${LUMO_TETGEN_INCLUDE}" ${LUMO_TETGEN_LIBRARY})
  lumo_pkg_config(lumo-tetgen "lumo with TetGen (AGPL-3+): tetrahedral meshes" "Requires: lumo = ${PROJECT_VERSION}\n${cflags}\n${libs}")
endif()
if(TARGET lumo::embree)
  lumo_flags_of(cflags libs "${LUMO_EMBREE_INCLUDE}" ${LUMO_EMBREE_LIBRARY})
  lumo_pkg_config(lumo-embree "lumo with Embree (Apache-2.0): rays" "Requires: lumo = ${PROJECT_VERSION}\n${cflags}\n${libs}")
endif()
if(TARGET lumo::cholmod)
  lumo_flags_of(cflags libs "${LUMO_CHOLMOD_INCLUDE}" ${LUMO_CHOLMOD_LIBRARY} ${LUMO_SUITESPARSECONFIG_LIBRARY})
  if(LUMO_OPENBLAS_LIBRARY)   # first, and although no program calls it: see lumoComponents.cmake
    lumo_flags_of(unused blas "" ${LUMO_OPENBLAS_LIBRARY})
    string(REPLACE "Libs:" "" blas "${blas}")
    string(REPLACE "Libs:" "Libs: -Wl,--push-state,--no-as-needed${blas} -Wl,--pop-state" libs "${libs}")
  endif()
  lumo_pkg_config(lumo-cholmod "lumo with CHOLMOD (LGPL-2.1+, its supernodal part GPL-2+): sparse Cholesky factors"
    "Requires: lumo = ${PROJECT_VERSION}\n${cflags}\n${libs}")
endif()
if(TARGET lumo::tbb)
  lumo_pkg_config(lumo-tbb "lumo with oneTBB (Apache-2.0): threads" "Requires: lumo = ${PROJECT_VERSION}, tbb\nCflags: -pthread\nLibs: -pthread")
endif()
if(TARGET lumo::opencv)
  lumo_pkg_config(lumo-opencv "lumo with OpenCV (Apache-2.0): images, videos, cameras" "Requires: lumo = ${PROJECT_VERSION}, opencv4\nLibs: -Wl,--as-needed")
endif()
if(TARGET lumo::sqlite)
  lumo_flags_of(cflags libs "${LUMO_XXHASH_INCLUDE}")
  lumo_pkg_config(lumo-sqlite "lumo with SQLite (public domain) and xxHash (BSD-2-Clause): stores" "Requires: lumo = ${PROJECT_VERSION}, sqlite3\n${cflags}")
endif()
if(TARGET lumo::zip)
  lumo_flags_of(cflags libs "${LUMO_ZIP_INCLUDE}" ${LUMO_ZIP_LIBRARY})
  lumo_pkg_config(lumo-zip "lumo with libzip (BSD-3-Clause): archives of printed parts" "Requires: lumo = ${PROJECT_VERSION}\n${cflags}\n${libs}")
endif()
if(TARGET lumo::lz4)
  lumo_flags_of(cflags libs "${LUMO_LZ4_INCLUDE}" ${LUMO_LZ4_LIBRARY})
  lumo_pkg_config(lumo-lz4 "lumo with LZ4 (BSD-2-Clause): chunks of MCAP files" "Requires: lumo = ${PROJECT_VERSION}\n${cflags}\n${libs}")
endif()
if(TARGET lumo::zstd)
  lumo_flags_of(cflags libs "${LUMO_ZSTD_INCLUDE}" ${LUMO_ZSTD_LIBRARY})
  lumo_pkg_config(lumo-zstd "lumo with Zstandard (BSD-3-Clause or GPL-2): chunks of MCAP files" "Requires: lumo = ${PROJECT_VERSION}\n${cflags}\n${libs}")
endif()
if(TARGET lumo::json)
  lumo_flags_of(cflags libs "${LUMO_JSON_INCLUDE}")
  lumo_pkg_config(lumo-json "lumo with nlohmann-json (MIT): logs" "Requires: lumo = ${PROJECT_VERSION}\n${cflags}")
endif()
