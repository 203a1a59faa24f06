# What most sources read: parsing these headers is half of the time to compile one.
set(EARSHOT_COMMON_HEADERS <fmt/format.h> <glm/glm.hpp> <algorithm> <array> <cmath> <filesystem> <fstream> <functional> <map> <memory> <mutex>
    <numbers> <optional> <set> <span> <sstream> <string> <vector>)

# earshot_library(NAME DIR [PCH TARGET] [EXCLUDE REGEX]): a static library of all .cpp files in DIR and below but those whose path matches REGEX.
# PCH: the target whose precompiled headers it reads.
function(earshot_library name dir)
  cmake_parse_arguments(PARSE_ARGV 2 arg "" "PCH;EXCLUDE" "")
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS ${dir}/*.cpp)
  if(arg_EXCLUDE)
    list(FILTER sources EXCLUDE REGEX "${arg_EXCLUDE}")
  endif()
  file(GLOB_RECURSE headers CONFIGURE_DEPENDS ${dir}/*.h)
  add_library(${name} STATIC ${sources} ${headers})
  set_target_properties(${name} PROPERTIES LINKER_LANGUAGE CXX)
  target_include_directories(${name} PUBLIC $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}> $<BUILD_INTERFACE:${PROJECT_BINARY_DIR}/generated>
                             $<INSTALL_INTERFACE:${EARSHOT_INSTALL_HEADERS}>)
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

# earshot_tests(DIR LIBS...): the tests of one folder, as up to three executables.  Each test has the folder as a label, so that a change runs the
# tests of its own folder (scripts/test.sh quick), and these:
#   *_slow_test.cpp     test_DIR_slow, label `slow`: statistics of `scripts/test.sh all`; the sanitizer presets leave them out
#   *_threads_test.cpp  test_DIR_threads, labels `fast` and `threads`: tests in which threads meet, all that the thread sanitizer builds
#                       (target thread_tests) and runs
#   other *_test.cpp    test_DIR, label `fast`
# Under a sanitizer, tests that tests/long_tests.txt names have the label `long` too.
# A leading unit/ is not part of the executables' names.  PCH TARGET: the target whose precompiled headers these tests read.  ALONE REGEX: tests
# that compare times, beside which ctest runs no others.  ROOMS FOLDER...: the
# tests of these folders in DIR; `*` stands for all.
function(earshot_tests dir)
  cmake_parse_arguments(PARSE_ARGV 1 arg "" "PCH;ALONE" "ROOMS")
  if(NOT arg_PCH)
    set(arg_PCH test_headers)
  endif()
  string(REGEX REPLACE "^unit/" "" stem ${dir})
  string(REPLACE "/" "_" stem ${stem})
  set(folders ${dir})
  if(arg_ROOMS)
    list(TRANSFORM arg_ROOMS PREPEND ${dir}/ OUTPUT_VARIABLE folders)
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
    if(sources AND (NOT kind STREQUAL "slow" OR EARSHOT_BUILD_SLOW_TESTS))
      add_executable(${target} ${sources})
      target_link_libraries(${target} PRIVATE ${arg_UNPARSED_ARGUMENTS} GTest::gtest GTest::gmock GTest::gtest_main test_paths project_flags)
      target_compile_options(${target} PRIVATE ${EARSHOT_TEST_OPTIMIZATION})
      target_precompile_headers(${target} REUSE_FROM ${arg_PCH})
      if(NOT kind STREQUAL "slow")
        earshot_join_sources(${target})
      endif()
      if(NOT dir MATCHES "^unit/sim/(base|rays)$")
        add_dependencies(${target} earshot_reader)
      endif()
      gtest_discover_tests(${target} DISCOVERY_MODE PRE_TEST DISCOVERY_TIMEOUT 120 PROPERTIES TIMEOUT 1500)
      # gtest_discover_tests splits a list of labels into properties, so a file that ctest reads after the discovery sets them.
      set(labels_file ${CMAKE_CURRENT_BINARY_DIR}/${target}_labels.cmake)
      file(WRITE ${labels_file} "if(${target}_TESTS)\n  set_tests_properties(\${${target}_TESTS} PROPERTIES LABELS \"${labels};${dir}\")\nendif()\n")
      if(arg_ALONE)
        file(APPEND ${labels_file} "foreach(test IN LISTS ${target}_TESTS)\n  if(test MATCHES \"${arg_ALONE}\")\n"
             "    set_tests_properties(\${test} PROPERTIES RUN_SERIAL ON)\n  endif()\nendforeach()\n")
      endif()
      if(EARSHOT_SANITIZE)
        set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/tests/long_tests.txt)
        file(STRINGS ${PROJECT_SOURCE_DIR}/tests/long_tests.txt long_tests REGEX "^[^#]")
        list(JOIN long_tests "|" long_tests)
        file(APPEND ${labels_file} "foreach(test IN LISTS ${target}_TESTS)\n  if(test MATCHES \"${long_tests}\")\n"
             "    set_tests_properties(\${test} PROPERTIES LABELS \"${labels};${dir};long\")\n  endif()\nendforeach()\n")
      endif()
      set_property(DIRECTORY APPEND PROPERTY TEST_INCLUDE_FILES ${labels_file})
      if(kind STREQUAL "threads")
        add_dependencies(thread_tests ${target})
      endif()
    endif()
  endforeach()
endfunction()
