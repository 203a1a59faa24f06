# SPDX-License-Identifier: Apache-2.0
# The software bill of materials of the program with all commands, beside it and in what is installed (component `program`).  Where dpkg is not the package manager there
# is none.
find_program(EARSHOT_DPKG_QUERY dpkg-query)
find_program(EARSHOT_PYTHON3 python3)
if(EARSHOT_DPKG_QUERY AND EARSHOT_PYTHON3 AND NOT CMAKE_CROSSCOMPILING)
  add_custom_command(OUTPUT ${PROJECT_BINARY_DIR}/earshot.cdx.json
    COMMAND ${EARSHOT_PYTHON3} ${PROJECT_SOURCE_DIR}/scripts/make_sbom.py program $<TARGET_FILE:earshot_training> --version ${PROJECT_VERSION}
            -o ${PROJECT_BINARY_DIR}/earshot.cdx.json
    DEPENDS earshot_training ${PROJECT_SOURCE_DIR}/scripts/make_sbom.py ${PROJECT_SOURCE_DIR}/scripts/library_licences.txt VERBATIM)
  add_custom_target(sbom ALL DEPENDS ${PROJECT_BINARY_DIR}/earshot.cdx.json)
  install(FILES ${PROJECT_BINARY_DIR}/earshot.cdx.json DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT program)
endif()
