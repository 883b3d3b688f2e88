/* Makes names that can serve as file names: unique (also without regard to upper and lower case), made of
 * [A-Za-z0-9._-], at most 120 bytes, and the same for the same sequence of requests. */
#ifndef KILN_COORDINATOR_IMPORT_NAMES_H
#define KILN_COORDINATOR_IMPORT_NAMES_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

enum { KILN_NAME_LENGTH = 120 };

/* Zero-initialise; release with kiln_names_destroy. */
struct kiln_names {
    struct kiln_names_entry {
        char *name;    /* NULL: free slot */
        uint32_t next; /* the number to append at the next request for this name */
    } * slots;
    size_t slot_count, used;
};

/* Writes the name nearest to `wish` that is not taken yet: other characters become '_', and a name that is taken gets
 * "_2", "_3", ... */
int kiln_names_unique(struct kiln_names *names, const char *wish, char name[KILN_NAME_LENGTH + 1],
                      struct kiln_error *error);
void kiln_names_destroy(struct kiln_names *names);

#endif
