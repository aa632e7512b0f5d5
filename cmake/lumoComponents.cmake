# Defines lumo::<component> for each foreign library that is found. Used by the build and by the installed package
# alike.
# LUMO_PACKAGE_<component> names the Debian package, LUMO_VERSION_<component> the version where a header tells it.
set(LUMO_COMPONENTS tetgen embree cholmod tbb opencv sqlite postgres json zip lz4 zstd)
set(LUMO_PACKAGE_tetgen libtet1.5-dev)
set(LUMO_PACKAGE_embree libembree-dev)
set(LUMO_PACKAGE_cholmod libsuitesparse-dev)
set(LUMO_PACKAGE_tbb libtbb-dev)
set(LUMO_PACKAGE_opencv libopencv-dev)
set(LUMO_PACKAGE_sqlite "libsqlite3-dev libxxhash-dev")
set(LUMO_PACKAGE_postgres "libpq-dev libxxhash-dev")
set(LUMO_PACKAGE_json nlohmann-json3-dev)
set(LUMO_PACKAGE_zip libzip-dev)
set(LUMO_PACKAGE_lz4 liblz4-dev)
set(LUMO_PACKAGE_zstd libzstd-dev)

macro(lumo_component name includes)  # further arguments: libraries
  if(NOT TARGET lumo::${name})
    add_library(lumo::${name} INTERFACE IMPORTED GLOBAL)
    set_target_properties(lumo::${name} PROPERTIES INTERFACE_LINK_LIBRARIES "lumo::lumo;${ARGN}")
    if(NOT "${includes}" STREQUAL "")
      set_target_properties(lumo::${name} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${includes}")
    endif()
  endif()
endmacro()

macro(lumo_find_component name headers)  # further arguments: names of its library; the first of either that is found
  string(TOUPPER ${name} upper)
  find_path(LUMO_${upper}_INCLUDE NAMES ${headers})
  find_library(LUMO_${upper}_LIBRARY NAMES ${ARGN})
  mark_as_advanced(LUMO_${upper}_INCLUDE LUMO_${upper}_LIBRARY)
  if(LUMO_${upper}_INCLUDE AND LUMO_${upper}_LIBRARY)
    lumo_component(${name} "${LUMO_${upper}_INCLUDE}" "${LUMO_${upper}_LIBRARY}")
  endif()
  unset(upper)
endmacro()

find_package(Threads QUIET)

lumo_find_component(tetgen tetgen.h tet tetgen)
if(LUMO_TETGEN_INCLUDE AND LUMO_TETGEN_LIBRARY)
  file(STRINGS ${LUMO_TETGEN_INCLUDE}/tetgen.h LUMO_VERSION_tetgen REGEX "Version [0-9.]+" LIMIT_COUNT 1)
  string(REGEX MATCH "[0-9]+(\\.[0-9]+)+" LUMO_VERSION_tetgen "${LUMO_VERSION_tetgen}")
endif()

lumo_find_component(embree "embree4/rtcore.h;embree3/rtcore.h" embree4 embree3)

# CHOLMOD calls a BLAS; the first one in link order wins, and the reference BLAS is many times slower than OpenBLAS.
find_path(LUMO_CHOLMOD_INCLUDE cholmod.h PATH_SUFFIXES suitesparse)
find_library(LUMO_CHOLMOD_LIBRARY cholmod)
find_library(LUMO_SUITESPARSECONFIG_LIBRARY suitesparseconfig)
find_library(LUMO_OPENBLAS_LIBRARY openblas)
find_library(LUMO_BLAS_LIBRARY blas)
mark_as_advanced(LUMO_CHOLMOD_INCLUDE LUMO_CHOLMOD_LIBRARY LUMO_SUITESPARSECONFIG_LIBRARY LUMO_OPENBLAS_LIBRARY
  LUMO_BLAS_LIBRARY)
if(LUMO_CHOLMOD_INCLUDE AND LUMO_CHOLMOD_LIBRARY AND LUMO_SUITESPARSECONFIG_LIBRARY)
  set(lumo_libraries "${LUMO_CHOLMOD_LIBRARY};${LUMO_SUITESPARSECONFIG_LIBRARY}")
  if(LUMO_OPENBLAS_LIBRARY)
    # Not every program calls OpenBLAS itself: a linker that drops unused libraries would drop it.
    list(PREPEND lumo_libraries "-Wl,--push-state,--no-as-needed" "${LUMO_OPENBLAS_LIBRARY}" "-Wl,--pop-state")
  elseif(LUMO_BLAS_LIBRARY)
    list(APPEND lumo_libraries "${LUMO_BLAS_LIBRARY}")
  endif()
  lumo_component(cholmod "${LUMO_CHOLMOD_INCLUDE}" ${lumo_libraries})
  unset(lumo_libraries)
endif()

find_package(TBB CONFIG QUIET)
if(TARGET TBB::tbb AND TARGET Threads::Threads)
  lumo_component(tbb "" TBB::tbb Threads::Threads)
endif()

find_package(OpenCV QUIET COMPONENTS core imgproc imgcodecs videoio)
if(OpenCV_FOUND)
  set(LUMO_VERSION_opencv ${OpenCV_VERSION})
  lumo_component(opencv "${OpenCV_INCLUDE_DIRS}" ${OpenCV_LIBS})
  # A program that links all components but reads no images should not load OpenCV and the fifty libraries below it at
  # its start.
  set_property(TARGET lumo::opencv PROPERTY INTERFACE_LINK_OPTIONS "LINKER:--as-needed")
endif()

find_package(SQLite3 QUIET)
find_path(LUMO_XXHASH_INCLUDE xxhash.h)
mark_as_advanced(LUMO_XXHASH_INCLUDE)
if(TARGET SQLite::SQLite3 AND LUMO_XXHASH_INCLUDE)
  lumo_component(sqlite "${LUMO_XXHASH_INCLUDE}" SQLite::SQLite3)
endif()

# Its header lies in a folder of its own, which the adapter names.
find_path(LUMO_POSTGRES_INCLUDE NAMES postgresql/libpq-fe.h libpq-fe.h)
find_library(LUMO_POSTGRES_LIBRARY pq)
mark_as_advanced(LUMO_POSTGRES_INCLUDE LUMO_POSTGRES_LIBRARY)
if(LUMO_POSTGRES_INCLUDE AND LUMO_POSTGRES_LIBRARY AND LUMO_XXHASH_INCLUDE)
  set(lumo_folders ${LUMO_POSTGRES_INCLUDE} ${LUMO_XXHASH_INCLUDE})
  list(REMOVE_DUPLICATES lumo_folders)
  lumo_component(postgres "${lumo_folders}" "${LUMO_POSTGRES_LIBRARY}")
  unset(lumo_folders)
endif()

find_path(LUMO_JSON_INCLUDE nlohmann/json.hpp)
mark_as_advanced(LUMO_JSON_INCLUDE)
if(LUMO_JSON_INCLUDE)
  lumo_component(json "${LUMO_JSON_INCLUDE}")
endif()

# libzip not by its own package file, which asks for command-line tools that Debian packs apart.
lumo_find_component(zip zip.h zip)
lumo_find_component(lz4 lz4frame.h lz4)
lumo_find_component(zstd zstd.h zstd)
