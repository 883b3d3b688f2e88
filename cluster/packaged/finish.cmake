# CPack runs this over the files of a Debian package before it packs them, for Debian's policy: pages are compressed,
# the licence is named instead of copied, and the packaging has a changelog of its own.
set(doc ${CPACK_TEMPORARY_INSTALL_DIRECTORY}/usr/share/doc/kiln)
set(man ${CPACK_TEMPORARY_INSTALL_DIRECTORY}/usr/share/man/man1/kiln.1)
set(version ${CPACK_PACKAGE_VERSION}-${CPACK_DEBIAN_PACKAGE_RELEASE})
string(TIMESTAMP day "%a, %d %b %Y %H:%M:%S +0000" UTC) # that of SOURCE_DATE_EPOCH, where it is set
file(REMOVE ${doc}/LICENSE)
file(RENAME ${doc}/CHANGELOG.md ${doc}/changelog)
file(WRITE ${doc}/changelog.Debian "kiln (${version}) unstable; urgency=medium

  * Made by cluster/package; changelog.gz says what is new.

 -- ${CPACK_PACKAGE_CONTACT}  ${day}
")
foreach(page ${doc}/changelog ${doc}/changelog.Debian ${man})
  if(EXISTS ${page})
    execute_process(COMMAND gzip -9nf ${page} COMMAND_ERROR_IS_FATAL ANY)
  endif()
endforeach()
