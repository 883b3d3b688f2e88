#include "coordinator/output/columns.h"

#include <string.h>

#include "coordinator/output/points.h"
#include "worker/base/memory.h"

const struct kiln_column_info kiln_columns[KILN_COLUMNS] = {
    [KILN_COLUMN_POSITION] = {"/points/position", KILN_DOUBLE, 3, true, "m",
                              "world position of the centroid of the part of the surface in the texel"},
    [KILN_COLUMN_NORMAL] = {"/points/normal", KILN_FLOAT, 3, false, "1", "unit shading normal there, world"},
    [KILN_COLUMN_OBJECT] = {"/points/object", KILN_UINT32, 1, false, "1", "index into /objects"},
    [KILN_COLUMN_TEXEL] = {"/points/texel", KILN_UINT32, 2, false, "texel",
                           "x and y in the object's lightmap, from the top left, v = 0 at the top"},
    [KILN_COLUMN_AREA] = {"/points/area", KILN_FLOAT, 1, false, "m2", "surface in the texel"},
    [KILN_COLUMN_ALBEDO] = {"/points/albedo", KILN_FLOAT, 3, false, "1", "mean diffuse albedo, linear RGB"},
    [KILN_COLUMN_VALID] =
        {"/points/valid", KILN_UINT8, 1, false, "1",
         "1 where light could be gathered; elsewhere /irradiance is 0 and lightmaps are filled from neighbours"},
    [KILN_COLUMN_CELL] = {"/points/cell", KILN_UINT32, 1, false, "1", "index into /cells"},
    [KILN_COLUMN_DIRECT] = {"/irradiance/direct", KILN_FLOAT, 3, false, NULL,
                            "from lights, about the shading normal, linear RGB, as gathered: not filled and seams not "
                            "smoothed (the lightmaps are)"},
    [KILN_COLUMN_INDIRECT] = {"/irradiance/indirect", KILN_FLOAT, 3, true, NULL,
                              "from other surfaces, about the shading normal, linear RGB, as gathered: not filled and "
                              "seams not smoothed (the lightmaps are)"},
    [KILN_COLUMN_TOTAL] = {"/irradiance/total", KILN_FLOAT, 3, true, NULL,
                           "direct + indirect, as gathered: not filled and seams not smoothed (the lightmaps are)"},
    [KILN_COLUMN_ERROR] = {"/irradiance/error", KILN_FLOAT, 1, true, NULL, "standard error of the luminance of total"},
    [KILN_COLUMN_SIDE] = {"/points/side", KILN_UINT8, 1, false, "1",
                          "0: of a front; 1: of a back, a double-sided surface seen from behind; its texels are twice "
                          "as wide as the object's unless its lightmap is published"},
};

size_t kiln_column_value(int column)
{
    const struct kiln_column_info *info = &kiln_columns[column];
    return info->type == KILN_DOUBLE ? sizeof(double) : info->type == KILN_UINT8 ? 1 : sizeof(float);
}

size_t kiln_column_row(int column) { return kiln_columns[column].components * kiln_column_value(column); }

int kiln_rows_allocate(struct kiln_rows *rows, size_t count, struct kiln_error *error)
{
    int status = KILN_OK;
    for (int c = 0; status == KILN_OK && c < KILN_COLUMNS; c++)
        status = kiln_allocate(&rows->column[c], count, kiln_column_row(c), "points to write", error);
    return status;
}

void kiln_rows_free(struct kiln_rows *rows)
{
    for (int c = 0; c < KILN_COLUMNS; c++)
        kiln_free(&rows->column[c]);
}

static void put_floats(void *column, uint64_t row, const float *values, int count)
{
    memcpy((float *)column + row * (uint64_t)count, values, (size_t)count * sizeof(float));
}

static void put_point(struct kiln_rows *rows, uint64_t row, const struct kiln_bake_result *result, uint64_t own,
                      const struct kiln_tile_run *tile_run, const struct kiln_point_detail *detail)
{
    const struct kiln_surface *s = result->surface;
    void *const *to = rows->column;
    const bool valid = kiln_point_valid(s, own);
    float albedo[3], light[3][3] = {{0}}, error = 0.0f;
    for (uint64_t c = 0; c < 3; c++) {
        albedo[c] = (float)s->albedo[3 * own + c] / 65535.0f;
        if (!valid)
            continue;
        light[0][c] = result->direct[3 * own + c];
        light[1][c] = result->indirect[3 * own + c];
        light[2][c] = light[0][c] + light[1][c];
        error = kiln_error_unpack(result->error[own]);
    }
    memcpy((double *)to[KILN_COLUMN_POSITION] + 3 * row, detail->position, sizeof detail->position);
    put_floats(to[KILN_COLUMN_NORMAL], row, detail->normal, 3);
    ((uint32_t *)to[KILN_COLUMN_OBJECT])[row] = kiln_map_object(s, tile_run->map);
    ((uint32_t *)to[KILN_COLUMN_TEXEL])[2 * row] = detail->x;
    ((uint32_t *)to[KILN_COLUMN_TEXEL])[2 * row + 1] = detail->y;
    put_floats(to[KILN_COLUMN_AREA], row, &s->area[own], 1);
    put_floats(to[KILN_COLUMN_ALBEDO], row, albedo, 3);
    ((uint8_t *)to[KILN_COLUMN_VALID])[row] = valid;
    ((uint32_t *)to[KILN_COLUMN_CELL])[row] = tile_run->cell;
    put_floats(to[KILN_COLUMN_DIRECT], row, light[0], 3);
    put_floats(to[KILN_COLUMN_INDIRECT], row, light[1], 3);
    put_floats(to[KILN_COLUMN_TOTAL], row, light[2], 3);
    put_floats(to[KILN_COLUMN_ERROR], row, &error, 1);
    ((uint8_t *)to[KILN_COLUMN_SIDE])[row] = kiln_map_back(s, tile_run->map);
}

/* The first tile run that ends after `point`. */
static size_t find_tile_run(const struct kiln_surface *s, uint64_t point)
{
    size_t low = 0, high = s->tile_run_count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (s->tile_runs[middle].first + s->tile_runs[middle].count <= point)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* A tile run on the border of two ranges is described in both. */
void kiln_rows_fill(struct kiln_rows *rows, const struct kiln_bake_result *result, uint64_t first, uint64_t last)
{
    const struct kiln_surface *s = result->surface;
    if (first >= last)
        return;
    const size_t from = find_tile_run(s, first), to = find_tile_run(s, last - 1) + 1;
#pragma omp parallel for schedule(dynamic, 64)
    for (size_t f = from; f < to; f++) {
        struct kiln_point_detail details[KILN_TILE_TEXELS];
        const struct kiln_tile_run *tile_run = &s->tile_runs[f];
        const uint32_t count = kiln_tile_run_details(result, f, details);
        for (uint32_t i = 0; i < count; i++) {
            const uint64_t point = tile_run->first + i;
            if (point >= first && point < last)
                put_point(rows, point - first, result, point - s->first, tile_run, &details[i]);
        }
    }
}
