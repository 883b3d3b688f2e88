/* What kiln.h5 says of each surface point, as columns: /points and /irradiance. Most are fields (coordinator/field/
 * field.h); the others are computed from the surface when the file is written. Not collective. */
#ifndef KILN_COORDINATOR_OUTPUT_COLUMNS_H
#define KILN_COORDINATOR_OUTPUT_COLUMNS_H

#include <stddef.h>
#include <stdint.h>

#include "coordinator/field/result.h"
#include "coordinator/output/points.h"

/* A point that is described. */
struct kiln_column_point {
    const struct kiln_bake_result *result;
    uint64_t own;
    const struct kiln_tile_run *tile_run;
    const struct kiln_point_detail *detail;
};

struct kiln_column {
    const char *name; /* of the dataset */
    enum kiln_column_type { KILN_DOUBLE, KILN_FLOAT, KILN_UINT32, KILN_UINT8 } type;
    uint32_t components;
    bool noisy;                      /* as kiln_chunk_pack has it */
    const char *units, *description; /* units NULL: of irradiance */
    /* writes one row; NULL: that of the field at place `field` of the bake's field set */
    void (*put)(void *row, const struct kiln_column_point *point);
    size_t field;
};

enum { KILN_COLUMNS_MAX = KILN_FIELDS_MAX + 16 };

/* The columns of one bake, in the file's order. */
struct kiln_columns {
    size_t count;
    struct kiln_column column[KILN_COLUMNS_MAX];
};

/* With `backs` there is one that tells them from fronts. */
void kiln_columns_make(struct kiln_columns *columns, const struct kiln_field_set *fields, bool backs);
/* The place of the column of that name; columns->count when there is none. */
size_t kiln_columns_find(const struct kiln_columns *columns, const char *name);

/* Bytes of one component, of one row, and of one row of all columns. */
size_t kiln_column_value(const struct kiln_column *column);
size_t kiln_column_row(const struct kiln_column *column);
size_t kiln_columns_row(const struct kiln_columns *columns);

/* Rows of some points, one array a column. */
struct kiln_rows {
    void *column[KILN_COLUMNS_MAX];
};

int kiln_rows_allocate(struct kiln_rows *rows, const struct kiln_columns *columns, size_t count,
                       struct kiln_error *error);
void kiln_rows_free(struct kiln_rows *rows);

/* Describes the global points [first, last), all own; the first goes to row 0. Shared by the threads. */
void kiln_rows_fill(struct kiln_rows *rows, const struct kiln_columns *columns, const struct kiln_bake_result *result,
                    uint64_t first, uint64_t last);

/* One own point's row of a column that is a field: what kiln_rows_fill puts there. */
void kiln_column_floats(const struct kiln_column *column, const struct kiln_bake_result *result, uint64_t own,
                        float floats[KILN_FIELD_COMPONENTS_MAX]);

#endif
