/* What kiln.h5 says of each surface point, as columns: /points and /irradiance. Not collective. */
#ifndef KILN_COORDINATOR_OUTPUT_COLUMNS_H
#define KILN_COORDINATOR_OUTPUT_COLUMNS_H

#include <stddef.h>
#include <stdint.h>

#include "coordinator/field/result.h"

enum kiln_column {
    KILN_COLUMN_POSITION,
    KILN_COLUMN_NORMAL,
    KILN_COLUMN_OBJECT,
    KILN_COLUMN_TEXEL,
    KILN_COLUMN_AREA,
    KILN_COLUMN_ALBEDO,
    KILN_COLUMN_VALID,
    KILN_COLUMN_CELL,
    KILN_COLUMN_DIRECT,
    KILN_COLUMN_INDIRECT,
    KILN_COLUMN_TOTAL,
    KILN_COLUMN_ERROR,
    KILN_COLUMN_SIDE, /* only where there are backs: the last one */
    KILN_COLUMNS
};

struct kiln_column_info {
    const char *name;
    enum { KILN_DOUBLE, KILN_FLOAT, KILN_UINT32, KILN_UINT8 } type;
    uint32_t components;
    bool noisy; /* as kiln_chunk_pack has it */
    const char *units, *description;
};

extern const struct kiln_column_info kiln_columns[KILN_COLUMNS];

/* How many of them a surface has. */
static inline int kiln_columns_of(const struct kiln_surface *surface)
{
    return surface->map_count > surface->object_count ? KILN_COLUMNS : KILN_COLUMN_SIDE;
}

/* Bytes of one component, and of one row. */
size_t kiln_column_value(int column);
size_t kiln_column_row(int column);

/* Rows of some columns, one array a column. */
struct kiln_rows {
    void *column[KILN_COLUMNS];
};

int kiln_rows_allocate(struct kiln_rows *rows, size_t count, struct kiln_error *error);
void kiln_rows_free(struct kiln_rows *rows);

/* Describes the global points [first, last), all own; the first goes to row 0. Shared by the threads. */
void kiln_rows_fill(struct kiln_rows *rows, const struct kiln_bake_result *result, uint64_t first, uint64_t last);

#endif
