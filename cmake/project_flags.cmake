# SPDX-License-Identifier: Apache-2.0
# Compile flags that every target of ours shares.  Linked PRIVATE, so nothing leaks to a user of the library.
add_library(project_flags INTERFACE)

set(EARSHOT_SANITIZE "" CACHE STRING "Value of -fsanitize=, empty for none")
if(CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|AMD64)$")
  set(default_arch x86-64-v3)
elseif(CMAKE_SYSTEM_PROCESSOR MATCHES "^(aarch64|arm64)$")
  set(default_arch armv8-a)
else()
  set(default_arch "")
endif()
set(EARSHOT_ARCH "${default_arch}" CACHE STRING
    "Value of -march=, empty for the compiler's own default; by default x86-64-v3 on x86-64 and armv8-a, which any has, on arm64")

option(EARSHOT_WARNINGS_AS_ERRORS "Fail on a warning; for the compilers that CI builds with" OFF)

target_compile_options(project_flags INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion
  $<$<BOOL:${EARSHOT_WARNINGS_AS_ERRORS}>:-Werror>
  # g++ 12 at -O3 sees overlaps and copies of 2^63 bytes in std::string's own operator+ (GCC bug 105651), and no longer counts that as a system
  # header once it is precompiled; the address sanitizer finds the true ones.
  $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>
  $<$<CXX_COMPILER_ID:GNU>:-Wno-stringop-overflow>
  $<$<CXX_COMPILER_ID:GNU>:-Wno-array-bounds>
  # C++14 has it; clang asks.
  $<$<CXX_COMPILER_ID:Clang>:-fsized-deallocation>
  # a*b+c must round the same way in every translation unit and on every machine: results are promised bit for bit.
  -ffp-contract=off
  # Messages of failed expectations name files from the root of the repository.
  -fmacro-prefix-map=${PROJECT_SOURCE_DIR}/=)
target_include_directories(project_flags INTERFACE ${PROJECT_SOURCE_DIR} ${PROJECT_BINARY_DIR}/generated)

if(EARSHOT_ARCH)
  # One of another kind of processor, say, left over in a script: the compiler would refuse it in each of a thousand files.
  include(CheckCXXCompilerFlag)
  string(MAKE_C_IDENTIFIER "EARSHOT_KNOWS_${CMAKE_SYSTEM_PROCESSOR}_${EARSHOT_ARCH}" known)
  check_cxx_compiler_flag(-march=${EARSHOT_ARCH} ${known})
  if(NOT ${known})
    message(FATAL_ERROR " EARSHOT_ARCH is '${EARSHOT_ARCH}', which ${CMAKE_CXX_COMPILER} does not know for ${CMAKE_SYSTEM_PROCESSOR}: leave the key out for '${default_arch}', or give another value of -march=")
  endif()
  target_compile_options(project_flags INTERFACE -march=${EARSHOT_ARCH})
endif()
if(NOT EARSHOT_ARCH STREQUAL default_arch)
  # Vectors of eight floats are handed over otherwise where there is no AVX; no function that takes them is called from outside.
  target_compile_options(project_flags INTERFACE -Wno-psabi)
endif()

# mold links the forty programs of the tests several times as fast as GNU ld.  A cross compiler looks for it under a name of its own.
include(CheckLinkerFlag)
check_linker_flag(CXX -fuse-ld=mold EARSHOT_LINKS_BY_MOLD)
if(EARSHOT_LINKS_BY_MOLD)
  # Without pages of their own for segments, mold 1.10 may begin the part that is made read-only after relocation in a page that is not mapped (code
  # that ends in the last seven bytes of a page, before a thread_local of one byte): the program then does not start.
  add_link_options(-fuse-ld=mold LINKER:-z,separate-loadable-segments)
endif()

if(EARSHOT_SANITIZE)
  # Warnings differ from compiler to compiler, and with instrumented code; the release build is the one that judges.
  target_compile_options(project_flags INTERFACE -Wno-error)
  # The first finding ends a program, with a stack.
  add_compile_options(-fsanitize=${EARSHOT_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer)
  if(EARSHOT_SANITIZE MATCHES "address" AND EARSHOT_SANITIZE MATCHES "undefined")
    # The address sanitizer reports the same faults; these two checks are a quarter of the time to compile.
    add_compile_options(-fno-sanitize=null,object-size)
  endif()
  add_link_options(-fsanitize=${EARSHOT_SANITIZE})
  # For tests of what a sanitizer brings its own of: memory, and limits on it.
  add_compile_definitions(EARSHOT_SANITIZED)
endif()
