/* The columns of kiln.h5: the datasets in /points and /irradiance, with one row for each surface point. Most columns
 * are fields (coordinator/field/field.h); the others are computed from the surface when the file is written. Not
 * collective. */
#ifndef KILN_COORDINATOR_OUTPUT_COLUMNS_H
#define KILN_COORDINATOR_OUTPUT_COLUMNS_H

#include <stddef.h>
#include <stdint.h>

#include "coordinator/field/result.h"
#include "coordinator/output/points.h"

/* A surface point for which a row is written. */
struct kiln_column_point {
    const struct kiln_bake_result *result;
    struct kiln_own_point own;
    const struct kiln_tile_run *tile_run;
    const struct kiln_point_detail *detail;
};

struct kiln_column {
    const char *name; /* name of the dataset */
    enum kiln_column_type { KILN_DOUBLE, KILN_FLOAT, KILN_UINT32, KILN_UINT8 } type;
    uint32_t components;
    bool noisy;                      /* as kiln_chunk_pack has it */
    bool early;                      /* computable from the surface alone, before there is light (points_ahead.h) */
    bool of_direct;                  /* computable from direct light alone */
    const char *units, *description; /* units NULL: those of field number `field` */
    /* writes one row; NULL: the row is that of field number `field` of the bake's field set */
    void (*put)(void *row, const struct kiln_column_point *point);
    size_t field;
};

enum { KILN_COLUMNS_MAX = KILN_FIELDS_MAX + 16 };

/* The columns of a bake, in the order of the file. */
struct kiln_columns {
    size_t count;
    struct kiln_column column[KILN_COLUMNS_MAX];
};

/* Lists the columns of a bake. kiln_columns_make does so before the bake exists: `backs` adds a column that
 * distinguishes backs from fronts; with `octree` points are leaves, not texels; `parts` adds a column for the parts of
 * divided texels. */
void kiln_columns_of(struct kiln_columns *columns, const struct kiln_bake_result *result);
void kiln_columns_make(struct kiln_columns *columns, const struct kiln_field_set *fields, bool backs, bool octree,
                       bool parts);
/* Index of the column of that name; columns->count if there is none. */
size_t kiln_columns_find(const struct kiln_columns *columns, const char *name);

/* Bytes of one component, of one row, and of one row of all columns. */
size_t kiln_column_value(const struct kiln_column *column);
size_t kiln_column_row(const struct kiln_column *column);
size_t kiln_columns_row(const struct kiln_columns *columns);

/* Rows of some points: one array for each column; NULL: the column is not requested. */
struct kiln_column_values {
    void *column[KILN_COLUMNS_MAX];
};

int kiln_column_values_allocate(struct kiln_column_values *rows, const struct kiln_columns *columns, size_t count,
                                struct kiln_error *error);
void kiln_column_values_free(struct kiln_column_values *rows);

/* Fills in the rows of the points [first, last), which this rank must own; `first` is row 0. Uses all threads.
 */
void kiln_column_values_fill(struct kiln_column_values *rows, const struct kiln_columns *columns,
                             const struct kiln_bake_result *result, struct kiln_global_point first,
                             struct kiln_global_point last);

/* Writes the rows of own points in a column that is a field, as kiln_column_values_fill does: at most KILN_TILE_TEXELS
 * points from `first` on. */
void kiln_column_floats(const struct kiln_column *column, const struct kiln_bake_result *result,
                        struct kiln_own_point first, uint32_t points, float *floats);

#endif
