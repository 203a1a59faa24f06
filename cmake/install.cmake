# cmake --install: the program, those that it starts, the libraries and their headers, and what find_package(Earshot) reads.  One export set per part, so
# that a user of sim needs neither torch nor zmq.  Components: `program` (what cmake/packaging.cmake puts into the .deb) and `development`.
include(CMakePackageConfigHelpers)
set(package_folder ${CMAKE_INSTALL_LIBDIR}/cmake/Earshot)

set(parts sim envs datasets)
set(libraries_sim sim sim_base sim_rays sim_scene sim_audio sim_acoustics sim_vision sim_nav earshot_reader)
set(libraries_envs envs)
set(libraries_datasets datasets)
if(EARSHOT_BUILD_TRAINING)
  list(APPEND parts policy trainer evaluation)
  set(libraries_policy policy policy_plain)
  set(libraries_trainer trainer trainer_plain trainer_net trainer_launch trainer_collective)
  set(libraries_evaluation evaluation evaluation_plain)
  install(TARGETS earshot COMPONENT program)
  install(TARGETS earshot_training RUNTIME DESTINATION ${CMAKE_INSTALL_LIBEXECDIR}/earshot COMPONENT program)
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

set_target_properties(earshot_reader PROPERTIES EXPORT_NAME reader)
foreach(part IN LISTS parts)
  install(TARGETS ${libraries_${part}} EXPORT Earshot_${part}
          ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}/earshot COMPONENT development
          RUNTIME DESTINATION ${CMAKE_INSTALL_LIBEXECDIR}/earshot COMPONENT program)
  install(EXPORT Earshot_${part} NAMESPACE earshot:: DESTINATION ${package_folder} COMPONENT development)
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/${part} DESTINATION ${EARSHOT_INSTALL_HEADERS} COMPONENT development
          FILES_MATCHING PATTERN "*.h" PATTERN "*_impl.h" EXCLUDE PATTERN reader EXCLUDE
          # The inside of BatchedEnv.
          REGEX "envs/batch/(agent_[a-z]*|batch_[a-z]*|env_[a-z]*|environment|episode_[a-z]*|fault_desk|picture_queue|stage_clock)\\.h$" EXCLUDE)
endforeach()
install(FILES ${PROJECT_BINARY_DIR}/generated/sim/base/version.h DESTINATION ${EARSHOT_INSTALL_HEADERS}/sim/base
        COMPONENT development)

list(JOIN parts " " parts)
configure_package_config_file(${CMAKE_CURRENT_LIST_DIR}/EarshotConfig.cmake.in ${PROJECT_BINARY_DIR}/generated/EarshotConfig.cmake
                              INSTALL_DESTINATION ${package_folder} NO_SET_AND_CHECK_MACRO)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/generated/EarshotConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/generated/EarshotConfig.cmake ${PROJECT_BINARY_DIR}/generated/EarshotConfigVersion.cmake
              ${CMAKE_CURRENT_LIST_DIR}/EarshotDependencies.cmake DESTINATION ${package_folder} COMPONENT development)
