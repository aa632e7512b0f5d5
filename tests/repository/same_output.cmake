# cmake -DFIRST=PROGRAM -DSECOND=PROGRAM -P same_output.cmake: both print the same, and something.
foreach(program FIRST SECOND)
  execute_process(COMMAND ${${program}} OUTPUT_VARIABLE ${program}_TEXT COMMAND_ERROR_IS_FATAL ANY)
endforeach()
if(FIRST_TEXT STREQUAL "" OR NOT FIRST_TEXT STREQUAL SECOND_TEXT)
  message(FATAL_ERROR "${FIRST} and ${SECOND} do not print the same")
endif()
