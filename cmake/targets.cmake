# SPDX-License-Identifier: Apache-2.0
# What most sources read: parsing these headers is half of the time to compile one.
set(EARSHOT_COMMON_HEADERS <fmt/format.h> <glm/glm.hpp> <algorithm> <array> <cmath> <filesystem> <fstream> <functional> <map> <memory> <mutex>
    <numbers> <optional> <set> <span> <sstream> <string> <vector>)

# earshot_library(NAME DIR [PCH TARGET] [EXCLUDE REGEX] [WITH_LIBTORCH | WITHOUT_LIBTORCH]): a static library of all .cpp files in DIR and below but
# those whose path matches REGEX, and of these only what needs libtorch or only what does not (libtorch_sources.cmake).  PCH: the target whose
# precompiled headers it reads.
function(earshot_library name dir)
  cmake_parse_arguments(PARSE_ARGV 2 arg "WITH_LIBTORCH;WITHOUT_LIBTORCH" "PCH;EXCLUDE" "")
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS ${dir}/*.cpp)
  if(arg_EXCLUDE)
    list(FILTER sources EXCLUDE REGEX "${arg_EXCLUDE}")
  endif()
  if(arg_WITH_LIBTORCH)
    earshot_split_by_libtorch(sources without ${sources})
  elseif(arg_WITHOUT_LIBTORCH)
    earshot_split_by_libtorch(with sources ${sources})
  endif()
  file(GLOB_RECURSE headers CONFIGURE_DEPENDS ${dir}/*.h)
  add_library(${name} STATIC ${sources} ${headers})
  set_target_properties(${name} PROPERTIES LINKER_LANGUAGE CXX)
  target_include_directories(${name} PUBLIC $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}> $<BUILD_INTERFACE:${PROJECT_BINARY_DIR}/generated>)
  target_link_libraries(${name} PRIVATE $<BUILD_INTERFACE:project_flags>)
  if(CMAKE_POSITION_INDEPENDENT_CODE)
    # No other library replaces functions of ours, so they may be inlined as in a program.
    target_compile_options(${name} PRIVATE -fno-semantic-interposition)
  endif()
  # A user's compiler needs C++20, and must round the functions of headers as the library does.
  target_compile_features(${name} PUBLIC cxx_std_20)
  target_compile_options(${name} INTERFACE $<INSTALL_INTERFACE:-ffp-contract=off>)
  add_library(earshot::${name} ALIAS ${name})
  list(LENGTH sources num_sources)
  if(arg_PCH)
    target_precompile_headers(${name} REUSE_FROM ${arg_PCH})
  elseif(num_sources GREATER 8)  # below, reading them once more costs what it saves
    target_precompile_headers(${name} PRIVATE ${EARSHOT_COMMON_HEADERS})
  endif()
  cmake_language(EVAL CODE "cmake_language(DEFER CALL earshot_join_sources ${name})")  # once the properties of all sources are known
endfunction()

# earshot_tests(DIR LIBS...): the tests of one folder, as an executable per kind.  Each test has the folder as a label, so that a change runs the
# tests of its own folder (scripts/test.sh quick), and these:
#   *_slow_test.cpp     test_DIR_slow, label `slow`: statistics of `scripts/test.sh all`; the sanitizer presets leave them out
#   *_threads_test.cpp  test_DIR_threads, labels `fast` and `threads`: tests in which threads meet, all that the thread sanitizer builds and runs
#                       (target thread_tests; test_datasets_threads, which alone links datasets, in `scripts/test.sh all`)
#   other *_test.cpp    test_DIR, label `fast`
# Those that tests/long_tests.txt names, and under a sanitizer tests/long_tests_address.txt or long_tests_thread.txt, have the label `long` too,
# and run in `scripts/test.sh all` alone.  Those that tests/first_tests.txt names begin before the others.
# Tests of code that parses outside files and messages, but for datasets, have the label `sanitized` (folders below): the address sanitizer
# runs them in CI (target sanitized_tests), and all tests but slow ones and those of bench in `scripts/test.sh all`.  Those that include
# libtorch, and those of the program, have the label `training`: they run under the address sanitizer in `scripts/test.sh all` (target
# training_tests of the preset asan-ubsan-training).
# A leading unit/ is not part of the executables' names.  ALONE REGEX: tests that compare times, beside which ctest runs no others.  ROOMS
# FOLDER...: the tests of DIR and of these folders in it; `*` stands for all.
# LIBTORCH LIBS...: tests that include libtorch are an executable of their own, test_DIR_libtorch, with these libraries, so that the others start
# at once.
function(earshot_tests dir)
  cmake_parse_arguments(PARSE_ARGV 1 arg "" "ALONE" "ROOMS;LIBTORCH")
  string(REGEX REPLACE "^unit/" "" stem ${dir})
  string(REPLACE "/" "_" stem ${stem})
  set(folders ${dir})
  if(arg_ROOMS)
    list(TRANSFORM arg_ROOMS PREPEND ${dir}/)
    list(APPEND folders ${arg_ROOMS})
  endif()
  list(TRANSFORM folders REPLACE "(.+)" "${PROJECT_SOURCE_DIR}/tests/\\1/*_test.cpp")
  file(GLOB all_tests CONFIGURE_DEPENDS ${folders})
  foreach(kind fast threads slow)
    set(sources ${all_tests})
    if(kind STREQUAL "fast")
      list(FILTER sources EXCLUDE REGEX "_(threads|slow)_test\\.cpp$")
      set(target test_${stem})
      set(labels fast)
    else()
      list(FILTER sources INCLUDE REGEX "_${kind}_test\\.cpp$")
      set(target test_${stem}_${kind})
      set(labels ${kind})
    endif()
    if(kind STREQUAL "threads")
      set(labels fast threads)
    endif()
    if(kind STREQUAL "slow" AND NOT EARSHOT_BUILD_SLOW_TESTS)
      continue()
    endif()
    set(sources_libtorch "")
    if(arg_LIBTORCH)
      earshot_split_by_libtorch(sources_libtorch sources ${sources})
    endif()
    if(sources)
      earshot_test_program(${target} "${dir}" "${labels}" "${arg_ALONE}" SOURCES ${sources} LIBS ${arg_UNPARSED_ARGUMENTS} PCH test_headers)
    endif()
    if(sources_libtorch AND EARSHOT_BUILD_TRAINING)
      earshot_test_program(${target}_libtorch "${dir}" "${labels}" "${arg_ALONE}" SOURCES ${sources_libtorch} LIBS ${arg_LIBTORCH} PCH policy)
    endif()
  endforeach()
endfunction()

# Regular expressions of the names of all long tests; CMake takes few groups in one.
set(earshot_long_tests "")
set(lists long_tests)
if(EARSHOT_SANITIZE MATCHES "^(address|thread)")
  list(APPEND lists long_tests_${CMAKE_MATCH_1})
endif()
foreach(list IN LISTS lists)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/tests/${list}.txt)
  file(STRINGS ${PROJECT_SOURCE_DIR}/tests/${list}.txt names REGEX "^[^#]")
  list(APPEND earshot_long_tests ${names})
endforeach()

# Tests that start first.
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/tests/first_tests.txt)
file(STRINGS ${PROJECT_SOURCE_DIR}/tests/first_tests.txt earshot_first_tests REGEX "^[^#]")

# earshot_test_program(TARGET DIR LABELS ALONE SOURCES... LIBS... PCH TARGET): one executable of earshot_tests.
function(earshot_test_program target dir labels alone)
  cmake_parse_arguments(PARSE_ARGV 4 arg "" "PCH" "SOURCES;LIBS")
  if(dir MATCHES "^(robustness|unit/(compat|sim/(base|rays|scene|audio|sofa|vision|nav)|trainer/(net|launch)))$")
    list(APPEND labels sanitized)
  endif()
  if(dir MATCHES "^unit/apps(/|$)" OR target MATCHES "_libtorch$")
    list(APPEND labels training)
  endif()
  add_executable(${target} ${arg_SOURCES})
  target_link_libraries(${target} PRIVATE ${arg_LIBS} GTest::gtest GTest::gmock GTest::gtest_main test_paths project_flags)
  target_compile_options(${target} PRIVATE ${EARSHOT_TEST_OPTIMIZATION})
  if("earshot_deps::msgpack" IN_LIST arg_LIBS)
    # Its zone allocates and frees by malloc and free; g++ 12 at -Og inlines only the one of the two.
    target_compile_options(${target} PRIVATE $<$<CXX_COMPILER_ID:GNU>:-Wno-mismatched-new-delete>)
  endif()
  target_precompile_headers(${target} REUSE_FROM ${arg_PCH})
  if(NOT "slow" IN_LIST labels)
    earshot_join_sources(${target})
  endif()
  if(NOT dir MATCHES "^unit/sim/(base|rays)$")
    add_dependencies(${target} earshot_reader)
  endif()
  gtest_discover_tests(${target} DISCOVERY_MODE PRE_TEST DISCOVERY_TIMEOUT 120 PROPERTIES TIMEOUT 1500)
  # gtest_discover_tests splits a list of labels into properties, so a file that ctest reads after the discovery sets them.
  set(labels_file ${CMAKE_CURRENT_BINARY_DIR}/${target}_labels.cmake)
  file(WRITE ${labels_file} "if(${target}_TESTS)\n  set_tests_properties(\${${target}_TESTS} PROPERTIES LABELS \"${labels};${dir}\")\nendif()\n")
  if(alone)
    file(APPEND ${labels_file} "foreach(test IN LISTS ${target}_TESTS)\n  if(test MATCHES \"${alone}\")\n"
         "    set_tests_properties(\${test} PROPERTIES RUN_SERIAL ON)\n  endif()\nendforeach()\n")
  endif()
  file(APPEND ${labels_file} "set(long_names \"${earshot_long_tests}\")\nforeach(name IN LISTS long_names)\n  set(long_tests \${${target}_TESTS})\n"
       "  list(FILTER long_tests INCLUDE REGEX \"\${name}\")\n  if(long_tests)\n"
       "    set_tests_properties(\${long_tests} PROPERTIES LABELS \"${labels};${dir};long\")\n  endif()\nendforeach()\n"
       "set(first_names \"${earshot_first_tests}\")\nforeach(name IN LISTS first_names)\n  set(first_tests \${${target}_TESTS})\n"
       "  list(FILTER first_tests INCLUDE REGEX \"\${name}\")\n  if(first_tests)\n"
       "    set_tests_properties(\${first_tests} PROPERTIES COST 100)\n  endif()\nendforeach()\n")
  set_property(DIRECTORY APPEND PROPERTY TEST_INCLUDE_FILES ${labels_file})
  if("threads" IN_LIST labels AND NOT dir STREQUAL "unit/datasets")
    add_dependencies(thread_tests ${target})
  endif()
  if("sanitized" IN_LIST labels)
    add_dependencies(sanitized_tests ${target})
  endif()
  if("training" IN_LIST labels)
    add_dependencies(training_tests ${target})
  endif()
endfunction()
