# Compile flags that every target of ours shares.  Linked PRIVATE, so nothing leaks to a user of the library.
add_library(project_flags INTERFACE)

set(EARSHOT_SANITIZE "" CACHE STRING "Value of -fsanitize=, empty for none")
set(EARSHOT_ARCH "x86-64-v3" CACHE STRING "Value of -march= on x86-64 machines, empty for the compiler's default")

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

if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64" AND EARSHOT_ARCH)
  target_compile_options(project_flags INTERFACE -march=${EARSHOT_ARCH})
endif()

# mold links the forty programs of the tests several times as fast as GNU ld.
find_program(EARSHOT_MOLD mold)
if(EARSHOT_MOLD)
  add_link_options(-fuse-ld=mold)
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
