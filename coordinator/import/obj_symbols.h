/* A hash table from names to numbers. Private to coordinator/import/obj*.c. */
#ifndef KILN_COORDINATOR_IMPORT_OBJ_SYMBOLS_H
#define KILN_COORDINATOR_IMPORT_OBJ_SYMBOLS_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

/* Zero-initialise; release with obj_symbols_destroy. */
struct obj_symbols {
    struct obj_symbol {
        size_t name, length; /* offset into `text`, and bytes */
        uint64_t hash;
        uint32_t value;
        uint32_t taken;
    } * slots;
    size_t slot_count, used;
    char *text;
    size_t text_size, text_capacity;
};

/* Looks up a name and writes its value to *value. A new name is entered with the value that *value has. */
int obj_symbol(struct obj_symbols *symbols, const char *name, size_t length, uint32_t *value, struct kiln_error *error);
void obj_symbols_destroy(struct obj_symbols *symbols);

#endif
