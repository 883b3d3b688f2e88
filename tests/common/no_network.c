/* A stand-in for libcurl, as cluster/bundle makes one: HDF5 reads files from web services with it, which kiln never
 * does. Each function ends the program. */
#include <stdlib.h>

#define NEVER(name)                                                                                                    \
    void name(void);                                                                                                   \
    void name(void) { abort(); }

NEVER(curl_easy_cleanup)
NEVER(curl_easy_init)
NEVER(curl_easy_perform)
NEVER(curl_easy_setopt)
NEVER(curl_global_cleanup)
NEVER(curl_global_init)
NEVER(curl_slist_append)
NEVER(curl_slist_free_all)
