# SPDX-License-Identifier: Apache-2.0
# Compiles on another machine for Debian on arm64, with Debian's cross compiler (package g++-12-aarch64-linux-gnu):
#   cmake -DCMAKE_TOOLCHAIN_FILE=cmake/aarch64.cmake -DEARSHOT_SYSROOT=FOLDER ...
# EARSHOT_SYSROOT: the root of a Debian of arm64 with the packages that Earshot needs (scripts/arm64.sh makes one).  Nothing but programs is looked
# for outside it.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_LIBRARY_ARCHITECTURE aarch64-linux-gnu)
set(CMAKE_TRY_COMPILE_PLATFORM_VARIABLES EARSHOT_SYSROOT)

if(NOT EARSHOT_SYSROOT OR NOT IS_DIRECTORY "${EARSHOT_SYSROOT}/usr/include")
  message(FATAL_ERROR " EARSHOT_SYSROOT is '${EARSHOT_SYSROOT}', which has no usr/include: give the root of a Debian of arm64 (scripts/arm64.sh makes one)")
endif()
set(CMAKE_SYSROOT "${EARSHOT_SYSROOT}")
if(NOT CMAKE_CXX_COMPILER)
  set(CMAKE_CXX_COMPILER aarch64-linux-gnu-g++-12)
endif()

set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE ONLY)
