# SPDX-License-Identifier: Apache-2.0
# All headers are looked for before any package, so that one line names everything that is missing.
include(${CMAKE_CURRENT_LIST_DIR}/EarshotDependencies.cmake)

set(parts sim envs)
if(EARSHOT_BUILD_TRAINING)
  list(APPEND parts policy trainer)
elseif(EARSHOT_FUZZ)
  list(APPEND parts trainer)  # the messages between workers are among what is fuzzed
endif()
set(headers "")
foreach(part IN LISTS parts)
  list(APPEND headers ${EARSHOT_HEADERS_${part}})
endforeach()
if(EARSHOT_BUILD_TRAINING)
  list(APPEND headers CLI/CLI.hpp libcli11-dev)  # the program needs libtorch for its commands
endif()
if(EARSHOT_BUILD_TESTS)
  list(APPEND headers gtest/gtest.h libgtest-dev gmock/gmock.h libgmock-dev ${EARSHOT_HEADERS_audio_permissive})
endif()
if(EARSHOT_BUILD_BENCH)
  list(APPEND headers benchmark/benchmark.h libbenchmark-dev)
endif()
earshot_missing_packages(missing ${headers})
if(missing)
  message(FATAL_ERROR " ${missing}")  # the space keeps CMake from breaking the line
endif()

earshot_find_packages(${parts})
if(EARSHOT_BUILD_TRAINING)
  find_package(CLI11 REQUIRED)
endif()
if(EARSHOT_BUILD_TESTS)
  find_package(GTest REQUIRED)
  include(GoogleTest)
endif()
if(EARSHOT_BUILD_BENCH)
  find_package(benchmark REQUIRED)
endif()
