# SPDX-License-Identifier: Apache-2.0
# Which sources need libtorch: those that include one of its headers, or a header of ours that includes one or is named torch_*.  The others
# build and start without it (docs/explanation/decisions.md).

# Sets RESULT to whether FILE, a path in the project, needs libtorch.
function(earshot_needs_libtorch result file)
  get_property(known GLOBAL PROPERTY earshot_libtorch_of_${file})
  if("${known}" STREQUAL "")
    set(known OFF)
    file(STRINGS ${PROJECT_SOURCE_DIR}/${file} includes REGEX "^#include [<\"]((torch|ATen|c10)/|(policy|trainer|evaluation|bench|tests)/)")
    foreach(include IN LISTS includes)
      string(REGEX REPLACE "^#include [<\"]([^>\"]+).*" "\\1" header ${include})
      if(header MATCHES "^(torch|ATen|c10)/|/torch_[^/]+\\.h$")
        set(known ON)
      elseif(EXISTS ${PROJECT_SOURCE_DIR}/${header})
        earshot_needs_libtorch(known ${header})
      endif()
      if(known)
        break()
      endif()
    endforeach()
    set_property(GLOBAL PROPERTY earshot_libtorch_of_${file} ${known})
  endif()
  set(${result} ${known} PARENT_SCOPE)
endfunction()

# earshot_split_by_libtorch(WITH WITHOUT SOURCES...): sorts absolute paths into the two lists.
function(earshot_split_by_libtorch with without)
  set(lists_ON "")
  set(lists_OFF "")
  foreach(source IN LISTS ARGN)
    file(RELATIVE_PATH path ${PROJECT_SOURCE_DIR} ${source})
    earshot_needs_libtorch(needs ${path})
    list(APPEND lists_${needs} ${source})
  endforeach()
  set(${with} ${lists_ON} PARENT_SCOPE)
  set(${without} ${lists_OFF} PARENT_SCOPE)
endfunction()
