include(CMakeFindDependencyMacro)
find_dependency(Eigen3 3.4 NO_MODULE)
include(${CMAKE_CURRENT_LIST_DIR}/lumoTargets.cmake)
include(${CMAKE_CURRENT_LIST_DIR}/lumoComponents.cmake)

# find_package(lumo COMPONENTS tetgen …) fails when an asked component's library is missing.
foreach(component IN LISTS lumo_FIND_COMPONENTS)
  if(TARGET lumo::${component})
    set(lumo_${component}_FOUND TRUE)
  elseif(lumo_FIND_REQUIRED_${component})
    set(lumo_FOUND FALSE)
    set(lumo_NOT_FOUND_MESSAGE "component ${component} needs ${LUMO_PACKAGE_${component}}")
  endif()
endforeach()
