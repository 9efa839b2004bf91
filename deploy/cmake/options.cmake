# Language level, warnings, instruction set and sanitizers, carried by one interface target.
option(PHOTONFARM_TESTS "Build the tests" ON)
option(PHOTONFARM_FUZZ "Build the libFuzzer targets (needs clang)" OFF)
option(PHOTONFARM_TIDY "Run clang-tidy while compiling" OFF)
set(PHOTONFARM_SANITIZE "" CACHE STRING "Comma-separated -fsanitize= list, e.g. address,undefined")

if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)

add_library(pf_options INTERFACE)
target_include_directories(pf_options INTERFACE "${PROJECT_SOURCE_DIR}")
target_compile_options(
  pf_options
  INTERFACE -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion -Wnon-virtual-dtor -Werror
            # One instruction set and no contraction: an image's bits depend on the job alone (README, "Reproducible").
            -march=x86-64-v3 -ffp-contract=off -fno-math-errno -fno-trapping-math)
if(CMAKE_UNITY_BUILD)
  # Most of a file's time is its headers', so eight files share them: 2.5 times less to compile. These two warnings
  # would be about names of one file that another one sees; dev compiles each file alone, with them.
  target_compile_options(pf_options INTERFACE -Wno-shadow
                                              $<$<CXX_COMPILER_ID:GNU>:-Wno-subobject-linkage>)
endif()
# Imath and Embree headers use float/int conversions that -Wconversion flags only when inlined into our code.
if(PHOTONFARM_SANITIZE)
  # Half the time to compile of -O2 -g, and asserts of third-party headers stay on; line tables are all a report needs.
  set(CMAKE_CXX_FLAGS_RELWITHDEBINFO "-O1 -g1")
  target_compile_options(pf_options INTERFACE -fsanitize=${PHOTONFARM_SANITIZE} -fno-omit-frame-pointer
                                              -fno-sanitize-recover=all)
  target_link_options(pf_options INTERFACE -fsanitize=${PHOTONFARM_SANITIZE})
endif()
if(PHOTONFARM_FUZZ)
  if(NOT CMAKE_CXX_COMPILER_ID STREQUAL "Clang")
    message(FATAL_ERROR "PHOTONFARM_FUZZ needs clang: -DCMAKE_CXX_COMPILER=clang++")
  endif()
  # g++ is the compiler that warnings are kept clean for; clang only has to instrument.
  target_compile_options(pf_options INTERFACE -Wno-error)
endif()
if(PHOTONFARM_TIDY)
  find_program(PHOTONFARM_CLANG_TIDY clang-tidy REQUIRED)
  # A merged source includes others on purpose; some warnings that are switched off are g++'s own.
  set(CMAKE_CXX_CLANG_TIDY "${PHOTONFARM_CLANG_TIDY};--quiet;--checks=-bugprone-suspicious-include"
                           "--extra-arg=-Wno-unknown-warning-option")
endif()
find_program(PHOTONFARM_CCACHE ccache)
if(PHOTONFARM_CCACHE)
  set(CMAKE_CXX_COMPILER_LAUNCHER "${PHOTONFARM_CCACHE}")
endif()

# pf_library(NAME [SOURCES ...] [PUBLIC ...] [PRIVATE ...]): every .cpp of the folder as one static library, or an
# interface library where the folder holds headers only.
function(pf_library name)
  cmake_parse_arguments(ARG "" "" "PUBLIC;PRIVATE;SOURCES" ${ARGN})
  if(NOT ARG_SOURCES)
    file(GLOB ARG_SOURCES CONFIGURE_DEPENDS "${CMAKE_CURRENT_SOURCE_DIR}/*.cpp")
  endif()
  if(NOT ARG_SOURCES)
    add_library(${name} INTERFACE)
    target_link_libraries(${name} INTERFACE pf_options ${ARG_PUBLIC} ${ARG_PRIVATE})
    return()
  endif()
  add_library(${name} STATIC ${ARG_SOURCES})
  target_link_libraries(${name} PUBLIC pf_options ${ARG_PUBLIC} PRIVATE ${ARG_PRIVATE})
endfunction()
