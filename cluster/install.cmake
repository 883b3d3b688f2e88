# What is installed, and the Debian package. In the project's folder, after a build:
#   cmake --install build/release --prefix /opt/kiln    # the program finds its files from where it stands
#   cluster/package                                     # build/kiln_VERSION-1_amd64.deb
# Files that other rules make (man page, completion, kernels of a file of their own) are installed where they are there.
include(GNUInstallDirs)
set(CMAKE_SKIP_INSTALL_ALL_DEPENDENCY ON) # what is built is installed: tests need not be
set(kiln_share ${CMAKE_INSTALL_DATADIR}/kiln)
set(kiln_doc ${CMAKE_INSTALL_DATADIR}/doc/kiln)

install(TARGETS kiln)
install(FILES ${PROJECT_BINARY_DIR}/kiln-float.kernels DESTINATION lib/kiln OPTIONAL)
install(FILES ${PROJECT_BINARY_DIR}/kiln.1 DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 OPTIONAL)
install(FILES ${PROJECT_BINARY_DIR}/kiln.bash DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions
  RENAME kiln OPTIONAL)
install(DIRECTORY jobs/ DESTINATION ${kiln_share}/jobs USE_SOURCE_PERMISSIONS
  PATTERN first-bake EXCLUDE
  PATTERN studies EXCLUDE
  PATTERN __pycache__ EXCLUDE)
install(DIRECTORY jobs/studies DESTINATION ${kiln_share} OPTIONAL PATTERN __pycache__ EXCLUDE)
install(FILES cluster/README.md cluster/HOSTS.md cluster/SCALING.md cluster/scaling-city.svg
  cluster/mpi-environment.sh DESTINATION ${kiln_share}/cluster)
install(DIRECTORY cluster/examples DESTINATION ${kiln_share}/cluster USE_SOURCE_PERMISSIONS)
install(FILES README.md CHANGELOG.md LICENSE cluster/packaged/copyright DESTINATION ${kiln_doc})
# Pages name each other by their paths in the repository.
file(MAKE_DIRECTORY ${PROJECT_BINARY_DIR}/pages)
foreach(name jobs cluster)
  file(CREATE_LINK ../../kiln/${name} ${PROJECT_BINARY_DIR}/pages/${name} SYMBOLIC)
  install(FILES ${PROJECT_BINARY_DIR}/pages/${name} DESTINATION ${kiln_doc})
endforeach()

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME kiln)
set(CPACK_PACKAGE_VENDOR "The maintainers of kiln")
set(CPACK_PACKAGE_CONTACT "The maintainers of kiln <maintainers@kiln.example>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "baker of lightmaps and irradiance volumes, on CPUs, GPUs and clusters")
set(CPACK_PACKAGE_DESCRIPTION "kiln takes a static 3D scene (glTF or OBJ), computes its global
illumination, and writes what engines and viewers read: a lightmap for
each object, the scene with the lightmaps' UVs and links, and an
irradiance volume for moving objects. The same bake gives the same bits
on any number of threads and ranks.")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE
  WORLD_READ WORLD_EXECUTE)
set(CPACK_STRIP_FILES ON)
set(CPACK_PRE_BUILD_SCRIPTS ${PROJECT_SOURCE_DIR}/cluster/packaged/finish.cmake)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION graphics)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
# Libraries by what the program is linked with; Open MPI's launcher is a program. mpirun looks for ssh even on one
# machine. The scripts of jobs/recipes and the studies are Python's; a GPU needs a driver of its own.
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_DEPENDS openmpi-bin)
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS
  "openssh-client, mesa-vulkan-drivers | vulkan-icd, python3, python3-numpy, python3-matplotlib, python3-h5py")
include(CPack)
