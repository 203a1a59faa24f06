# SPDX-License-Identifier: Apache-2.0
# cpack: a .deb with the program (component `program` of cmake/install.cmake), without headers and libraries.  scripts/build_deb.sh runs it.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME earshot)
set(CPACK_PACKAGE_VENDOR "The Earshot maintainers")
set(CPACK_PACKAGE_CONTACT "The Earshot maintainers <maintainers@earshot.invalid>")
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "runtime for reinforcement-learning agents that see and hear")
set(CPACK_PACKAGE_DESCRIPTION
  "Earshot computes room impulse responses on the fly in arbitrary 3D buildings,
steps batches of audio-visual navigation environments with continuous motion
and binaural sound, and trains agents by DD-PPO on CPUs. The same seed gives
the same bits for any number of threads.
.
Configs are in /usr/share/earshot/configs.")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)

set(CPACK_COMPONENTS_ALL program)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING ALL_COMPONENTS_IN_ONE)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
# Packages of two distributions need other libraries, so that their names tell: X.Y.Z-1~debian13.
cmake_host_system_information(RESULT distribution QUERY DISTRIB_ID)
cmake_host_system_information(RESULT release QUERY DISTRIB_VERSION_ID)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1~${distribution}${release})
if(CMAKE_CROSSCOMPILING AND CMAKE_SYSTEM_PROCESSOR STREQUAL "aarch64")
  set(CPACK_DEBIAN_PACKAGE_ARCHITECTURE arm64)
endif()
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_PRIORITY optional)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
# libtorch asks for any BLAS; the reference one trains several times slower (scripts/setup.sh).
set(CPACK_DEBIAN_PACKAGE_DEPENDS libopenblas0-pthread)
# Drivers for pictures by OpenGL: without them Embree draws.
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS "libegl-mesa0, libgl1-mesa-dri")
include(CPack)
