# SPDX-License-Identifier: Apache-2.0
# cmake --install: the program, those that it starts, the public headers (include/earshot), the libraries, and what find_package(Earshot) reads.
# One export set per part, so that a user of scenes and environments needs neither torch nor zmq.  A part is a library with public headers and the
# engine's libraries below it, which have none.  Components: `program` (what cmake/packaging.cmake puts into the .deb) and `development`.
include(CMakePackageConfigHelpers)
set(package_folder ${CMAKE_INSTALL_LIBDIR}/cmake/Earshot)

set(parts core datasets)
set(libraries_core api sim sim_base sim_rays sim_scene sim_audio sim_acoustics sim_vision sim_nav envs earshot_reader)
set(libraries_datasets api_datasets datasets)
if(EARSHOT_BUILD_TRAINING)
  list(APPEND parts training)
  set(libraries_training api_training policy policy_plain trainer trainer_plain trainer_net trainer_launch trainer_collective trainer_mpi
                         evaluation
                         evaluation_plain)
  install(TARGETS earshot COMPONENT program)
  install(TARGETS earshot_training RUNTIME DESTINATION ${CMAKE_INSTALL_LIBEXECDIR}/earshot COMPONENT program)
  if(TARGET earshot_hdf5_reader)
    install(TARGETS earshot_hdf5_reader RUNTIME DESTINATION ${CMAKE_INSTALL_LIBEXECDIR}/earshot COMPONENT program)
  endif()
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/configs DESTINATION ${CMAKE_INSTALL_DATADIR}/earshot COMPONENT program)
  install(FILES ${EARSHOT_SHELL_FOLDER}/earshot.bash DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions RENAME earshot
          COMPONENT program)
  install(FILES ${EARSHOT_SHELL_FOLDER}/_earshot DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/vendor-completions COMPONENT program)
  install(FILES ${EARSHOT_SHELL_FOLDER}/earshot.1.gz DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT program)
  install(FILES ${PROJECT_SOURCE_DIR}/README.md ${PROJECT_SOURCE_DIR}/CHANGELOG.md ${PROJECT_SOURCE_DIR}/CITATION.cff
                ${PROJECT_SOURCE_DIR}/SECURITY.md DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT program)
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/docs DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT program)
  install(FILES ${CMAKE_CURRENT_LIST_DIR}/copyright DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT program)
endif()

# In a folder of its own, for LD_LIBRARY_PATH: the engine that it replaces has the same name.
if(TARGET RLRAudioPropagation)
  install(TARGETS RLRAudioPropagation LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/earshot/compat COMPONENT program)
endif()

# Public names; all else is earshot::engine_NAME.
set_target_properties(earshot_reader PROPERTIES EXPORT_NAME reader)
set_target_properties(api PROPERTIES EXPORT_NAME core)
set_target_properties(api_datasets PROPERTIES EXPORT_NAME datasets)
set(public_targets earshot_reader api api_datasets)
if(EARSHOT_BUILD_TRAINING)
  set_target_properties(api_training PROPERTIES EXPORT_NAME training)
  list(APPEND public_targets api_training)
endif()
set(headers ${PROJECT_SOURCE_DIR}/include/earshot)
set(headers_datasets ${headers}/dataset.h)
set(headers_training ${headers}/policy.h ${headers}/train.h)
file(GLOB headers_core CONFIGURE_DEPENDS ${headers}/*.h)
list(REMOVE_ITEM headers_core ${headers_datasets} ${headers_training})
foreach(part IN LISTS parts)
  foreach(library IN LISTS libraries_${part})
    if(NOT library IN_LIST public_targets)
      set_target_properties(${library} PROPERTIES EXPORT_NAME engine_${library})
    endif()
  endforeach()
  install(TARGETS ${libraries_${part}} EXPORT Earshot_${part}
          ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}/earshot COMPONENT development
          RUNTIME DESTINATION ${CMAKE_INSTALL_LIBEXECDIR}/earshot COMPONENT program)
  install(EXPORT Earshot_${part} NAMESPACE earshot:: DESTINATION ${package_folder} COMPONENT development)
  install(FILES ${headers_${part}} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/earshot COMPONENT development)
endforeach()

list(JOIN parts " " parts)
configure_package_config_file(${CMAKE_CURRENT_LIST_DIR}/EarshotConfig.cmake.in ${PROJECT_BINARY_DIR}/generated/EarshotConfig.cmake
                              INSTALL_DESTINATION ${package_folder} NO_SET_AND_CHECK_MACRO)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/generated/EarshotConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/generated/EarshotConfig.cmake ${PROJECT_BINARY_DIR}/generated/EarshotConfigVersion.cmake
              ${CMAKE_CURRENT_LIST_DIR}/EarshotDependencies.cmake DESTINATION ${package_folder} COMPONENT development)
