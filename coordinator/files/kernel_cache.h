/* Cache folder of compiled device kernels (worker/base/kernel_store.h), one file KEY.kernel for each. Its format is
 *
 *     bytes 0-7    "KILNKERN"
 *           8-23   the key, 128 bits, most significant byte first
 *           24-31  the number of bytes from byte 48 on, little-endian like all that follows
 *           32-47  128-bit XXH3 hash of those bytes
 *           48-    data from the driver
 *
 * A file of another form, key or checksum counts as missing, and is replaced. Files are written under a temporary name
 * and renamed, without a sync: the checksum detects damage by a power cut. The files take 256 MiB at most together;
 * beyond that, the least recently read ones are removed. No failure here is an error; a folder that cannot be made or
 * written keeps nothing.
 *
 * The store's `file` reads files that come with the program, from the program's folder or from ../lib/kiln beside it.
 */
#ifndef KILN_COORDINATOR_FILES_KERNEL_CACHE_H
#define KILN_COORDINATOR_FILES_KERNEL_CACHE_H

#include <stdbool.h>

#include "worker/base/kernel_store.h"

enum { KILN_KERNEL_CACHE_BYTES = 256 << 20 };

/* Makes the store. `folder` is borrowed. NULL: `kiln/kernels` in $XDG_CACHE_HOME, or in ~/.cache; "none": nothing is
 * cached, and only `file` is set. */
struct kiln_kernel_store kiln_kernel_cache(const char *folder);

/* Marks of bakes whose kernels are all in the folder: empty files named by the hash of the bake's `kind`, a text, and
 * of this program's file. They serve forecasts (bake/reckon/kernels_kept.h): a mark may outlive kernels that were
 * removed, or stand for those of another device. `folder` as above. */
enum { KILN_KERNEL_KIND = 160 }; /* bytes of a kind, with its end */
void kiln_kernel_cache_mark(const char *folder, const char *kind);
bool kiln_kernel_cache_marked(const char *folder, const char *kind);

#endif
