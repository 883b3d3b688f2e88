/* A folder in which compiled kernels of devices are kept (worker/base/kernel_store.h): a file KEY.kernel each. It is
 *
 *     bytes 0-7    "KILNKERN"
 *           8-23   the key, 128 bits, most significant byte first
 *           24-31  the number of bytes from byte 48 on, little-endian like all that follows
 *           32-47  XXH3's 128 bits of these
 *           48-    what the driver gave
 *
 * A file of another form, key or checksum counts as none, and is replaced. Files are written aside and renamed, without
 * a sync: what a power cut leaves has another checksum. Together they take 256 MiB at most: beyond that those go that
 * were not read for longest. Nothing of this is an error; a folder that cannot be made or written keeps nothing.
 *
 * The store's `file` reads what comes with the program from the program's folder, or from ../lib/kiln of that. */
#ifndef KILN_COORDINATOR_FILES_KERNEL_CACHE_H
#define KILN_COORDINATOR_FILES_KERNEL_CACHE_H

#include "worker/base/kernel_store.h"

enum { KILN_KERNEL_CACHE_BYTES = 256 << 20 };

/* `folder` is borrowed. NULL: `kiln/kernels` in $XDG_CACHE_HOME, or in ~/.cache; "none": nothing is kept,
 * and `file` alone is there. */
struct kiln_kernel_store kiln_kernel_cache(const char *folder);

#endif
