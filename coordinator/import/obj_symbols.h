/* Private to coordinator/import/obj*.c: names and the numbers they stand for, found by hash. */
#ifndef KILN_COORDINATOR_IMPORT_OBJ_SYMBOLS_H
#define KILN_COORDINATOR_IMPORT_OBJ_SYMBOLS_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

/* Zero-initialise; release with obj_symbols_destroy. */
struct obj_symbols {
    struct obj_symbol {
        size_t name, length; /* into text */
        uint64_t hash;
        uint32_t value;
        uint32_t taken;
    } * slots;
    size_t slot_count, used;
    char *text;
    size_t text_size, text_capacity;
};

/* *value of a name; a new name gets the value given. */
int obj_symbol(struct obj_symbols *symbols, const char *name, size_t length, uint32_t *value, struct kiln_error *error);
void obj_symbols_destroy(struct obj_symbols *symbols);

#endif
