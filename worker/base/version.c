#include "worker/base/version.h"

#include <stddef.h>
#include <string.h>

bool kiln_version_has_same_bits(const char *version)
{
    return version != NULL && strverscmp(version, KILN_SAME_BITS_SINCE) >= 0 && strverscmp(version, KILN_VERSION) <= 0;
}
