# What lies below the libraries, for the build and, installed beside EarshotConfig.cmake, for projects that use them.  The parts are sim, envs,
# policy and trainer; each needs the parts before it.  Every package is Debian's; docs/dependencies.md says why each.

set(EARSHOT_HEADERS_sim
  embree3/rtcore.h libembree-dev  tbb/parallel_for.h libtbb-dev  assimp/Importer.hpp libassimp-dev  meshoptimizer.h libmeshoptimizer-dev
  Recast.h librecast-dev  DetourNavMesh.h librecast-dev  glm/glm.hpp libglm-dev  sndfile.h libsndfile1-dev  mysofa.h libmysofa-dev  xxhash.h libxxhash-dev  yaml-cpp/yaml.h libyaml-cpp-dev
  nlohmann/json.hpp nlohmann-json3-dev  fmt/format.h libfmt-dev  png.h libpng-dev  turbojpeg.h libturbojpeg0-dev
  EGL/egl.h libegl-dev  GLES3/gl3.h libgles-dev)
# What transforms and resamples sound (EARSHOT_AUDIO_LIBRARIES).
set(EARSHOT_HEADERS_audio_libav libavutil/tx.h libavutil-dev  libswresample/swresample.h libswresample-dev)
set(EARSHOT_HEADERS_audio_permissive samplerate.h libsamplerate0-dev)
list(APPEND EARSHOT_HEADERS_sim ${EARSHOT_HEADERS_audio_${EARSHOT_AUDIO_LIBRARIES}})
set(EARSHOT_HEADERS_envs zlib.h zlib1g-dev  spdlog/spdlog.h libspdlog-dev)
set(EARSHOT_HEADERS_policy torch/torch.h libtorch-dev)
set(EARSHOT_HEADERS_trainer zmq.h libzmq3-dev  zmq.hpp cppzmq-dev  msgpack.hpp libmsgpack-cxx-dev)

# Folders below those of the compiler in which Debian puts headers.
set(EARSHOT_HEADER_FOLDERS recastnavigation torch/csrc/api/include)

# earshot_missing_packages(VARIABLE [HEADER PACKAGE]...): empty, or one line that names the headers that are not found and the command that
# installs them.  Nothing is cached: what was installed or removed since the last configure is seen.
function(earshot_missing_packages variable)
  set(headers "")
  set(packages "")
  while(ARGN)
    list(POP_FRONT ARGN header package)
    unset(folder)
    find_path(folder ${header} PATH_SUFFIXES ${EARSHOT_HEADER_FOLDERS} NO_CACHE)
    if(NOT folder)
      list(APPEND headers ${header})
      list(APPEND packages ${package})
    endif()
  endwhile()
  set(${variable} "" PARENT_SCOPE)
  if(headers)
    list(REMOVE_DUPLICATES packages)
    list(JOIN headers ", " headers)
    list(JOIN packages " " packages)
    set(${variable} "earshot: missing ${headers}: apt-get install ${packages} (or run scripts/setup.sh)" PARENT_SCOPE)
  endif()
endfunction()

# earshot_import(NAME HEADER LIBRARIES...): target earshot_deps::NAME, for a package without a CMake file.  pkg-config is not used: what it gives for
# zmq changes its place in the command line between a first and a second configure, so that everything that links zmq is compiled again.
function(earshot_import name header)
  if(TARGET earshot_deps::${name})
    return()
  endif()
  find_path(folder ${header} PATH_SUFFIXES ${EARSHOT_HEADER_FOLDERS} REQUIRED NO_CACHE)
  add_library(earshot_deps::${name} INTERFACE IMPORTED)
  target_include_directories(earshot_deps::${name} SYSTEM INTERFACE ${folder})
  foreach(library IN LISTS ARGN)
    find_library(file_${library} ${library} REQUIRED NO_CACHE)
    target_link_libraries(earshot_deps::${name} INTERFACE ${file_${library}})
  endforeach()
endfunction()

# earshot_find_packages(PARTS...): makes the targets that these parts link.
function(earshot_find_packages)
  find_package(Threads REQUIRED)
  if("sim" IN_LIST ARGN)
    find_package(embree 3 REQUIRED)
    find_package(TBB REQUIRED)
    find_package(assimp REQUIRED)
    find_package(yaml-cpp REQUIRED)
    find_package(nlohmann_json REQUIRED)
    find_package(fmt REQUIRED)
    find_package(meshoptimizer REQUIRED)
    earshot_import(sndfile sndfile.h sndfile)
    if(EARSHOT_AUDIO_LIBRARIES STREQUAL "libav")
      earshot_import(libav libavutil/tx.h avutil swresample)
    else()
      earshot_import(samplerate samplerate.h samplerate)
    endif()
    earshot_import(mysofa mysofa.h mysofa)
    earshot_import(xxhash xxhash.h xxhash)
    earshot_import(recast Recast.h Recast Detour)
    earshot_import(png png.h png)
    earshot_import(turbojpeg turbojpeg.h turbojpeg)
    earshot_import(gles GLES3/gl3.h GLESv2)
    earshot_import(egl EGL/egl.h EGL)
  endif()
  if("envs" IN_LIST ARGN)
    find_package(spdlog REQUIRED)
    find_package(ZLIB REQUIRED)
  endif()
  if("policy" IN_LIST ARGN)
    # The package's own TorchConfig pulls in protobuf, CUDA checks and forty more libraries; these three are what is called.
    earshot_import(libtorch torch/torch.h torch torch_cpu c10)
    target_link_libraries(earshot_deps::libtorch INTERFACE Threads::Threads)
  endif()
  if("trainer" IN_LIST ARGN)
    find_package(msgpack REQUIRED CONFIG)
    earshot_import(zmq zmq.hpp zmq)
  endif()
endfunction()
