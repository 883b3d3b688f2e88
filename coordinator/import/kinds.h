/* Counts of a file's features by kind, for one note: "3 animations; 2 nodes with KHR_xmp_json_ld". */
#ifndef KILN_COORDINATOR_IMPORT_KINDS_H
#define KILN_COORDINATOR_IMPORT_KINDS_H

#include "coordinator/scene/builder.h"

enum { KILN_KINDS_MOST = 24, KILN_KINDS_NAME = 100 };

/* A kind: `name` with its count. Kinds beyond KILN_KINDS_MOST are counted together in `others`. Zero-initialise. */
struct kiln_kinds {
    struct kiln_kind_count {
        char name[KILN_KINDS_NAME];
        uint64_t count;
    } kinds[KILN_KINDS_MOST];
    size_t used;
    uint64_t others;
};

/* Adds `count` to the kind whose name is the formatted text; a count of 0 adds nothing. */
void kiln_kinds_add(struct kiln_kinds *kinds, uint64_t count, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
/* Adds notes that begin with `begin` and list the kinds in the order of their first use; no note if there are no kinds.
 */
int kiln_kinds_note(const struct kiln_kinds *kinds, struct kiln_builder *builder, uint32_t severity, const char *begin,
                    struct kiln_error *error);

#endif
