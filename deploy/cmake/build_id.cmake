# The build id names what can change an image's bits: version, compiler, flags and instruction set, source revision.
find_package(Git QUIET)
set(PHOTONFARM_REVISION "unknown")
if(GIT_FOUND)
  execute_process(COMMAND ${GIT_EXECUTABLE} -C ${PROJECT_SOURCE_DIR} describe --always --dirty --abbrev=12
                  OUTPUT_VARIABLE PHOTONFARM_REVISION OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
endif()
set(PHOTONFARM_BUILD_ID
    "${PROJECT_VERSION}-${PHOTONFARM_REVISION}-${CMAKE_CXX_COMPILER_ID}${CMAKE_CXX_COMPILER_VERSION}-x86-64-v3")
configure_file("${CMAKE_CURRENT_LIST_DIR}/build_id.h.in" "${PROJECT_BINARY_DIR}/generated/build_id.h")
target_include_directories(pf_options INTERFACE "${PROJECT_BINARY_DIR}/generated")
