# Included by every project() when message packages are built against the wheels of ROS 2. Their imported targets
# name include directories of the machine that made the wheels, which CMake refuses when they are not there.
function(mapmeld_drop_missing_includes)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(includes ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(includes)
      list(FILTER includes EXCLUDE REGEX "^/opt/python/")
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${includes}")
    endif()
  endforeach()
endfunction()
# At the end of the project's file, when its packages have been found.
cmake_language(DEFER CALL mapmeld_drop_missing_includes)
