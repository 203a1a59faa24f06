# cmake --install: the program, its reader, the libraries and their headers, and what find_package(Earshot) reads.  One export set per part, so
# that a user of sim needs neither torch nor zmq.
include(CMakePackageConfigHelpers)
set(package_folder ${CMAKE_INSTALL_LIBDIR}/cmake/Earshot)

set(parts sim envs)
set(libraries_sim sim sim_base sim_rays sim_scene sim_audio sim_acoustics sim_vision sim_nav earshot_reader)
set(libraries_envs envs)
if(EARSHOT_BUILD_TRAINING)
  list(APPEND parts policy trainer)
  set(libraries_policy policy)
  set(libraries_trainer trainer)
  install(TARGETS earshot)
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/configs DESTINATION ${CMAKE_INSTALL_DATADIR}/earshot)
endif()

set_target_properties(earshot_reader PROPERTIES EXPORT_NAME reader)
foreach(part IN LISTS parts)
  install(TARGETS ${libraries_${part}} EXPORT Earshot_${part} ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}/earshot
          RUNTIME DESTINATION ${CMAKE_INSTALL_LIBEXECDIR}/earshot)
  install(EXPORT Earshot_${part} NAMESPACE earshot:: DESTINATION ${package_folder})
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/${part} DESTINATION ${EARSHOT_INSTALL_HEADERS}
          FILES_MATCHING PATTERN "*.h" PATTERN "*_impl.h" EXCLUDE PATTERN reader EXCLUDE)
endforeach()
install(FILES ${PROJECT_BINARY_DIR}/generated/sim/base/version.h DESTINATION ${EARSHOT_INSTALL_HEADERS}/sim/base)

list(JOIN parts " " parts)
configure_package_config_file(${CMAKE_CURRENT_LIST_DIR}/EarshotConfig.cmake.in ${PROJECT_BINARY_DIR}/generated/EarshotConfig.cmake
                              INSTALL_DESTINATION ${package_folder} NO_SET_AND_CHECK_MACRO)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/generated/EarshotConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/generated/EarshotConfig.cmake ${PROJECT_BINARY_DIR}/generated/EarshotConfigVersion.cmake
              ${CMAKE_CURRENT_LIST_DIR}/EarshotDependencies.cmake DESTINATION ${package_folder})
