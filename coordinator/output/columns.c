#include "coordinator/output/columns.h"

#include <assert.h>
#include <string.h>

#include "worker/base/memory.h"

/* ---- columns that are not fields ---- */

static void put_position(void *row, const struct kiln_column_point *p)
{
    memcpy(row, p->detail->position, sizeof p->detail->position);
}

static void put_normal(void *row, const struct kiln_column_point *p)
{
    memcpy(row, p->detail->normal, sizeof p->detail->normal);
}

static void put_object(void *row, const struct kiln_column_point *p)
{
    *(uint32_t *)row = kiln_map_object(p->result->surface, p->tile_run->map);
}

static void put_texel(void *row, const struct kiln_column_point *p)
{
    memcpy(row, (const uint32_t[]){p->detail->x, p->detail->y}, 2 * sizeof(uint32_t));
}

static void put_leaf(void *row, const struct kiln_column_point *p)
{
    memcpy(row, p->detail->leaf, sizeof p->detail->leaf);
}

/* Writes the side of the triangles at an octree's point. For backs it is the opposite of the front's. */
static void put_facing(void *row, const struct kiln_column_point *p)
{
    const struct kiln_surface *s = p->result->surface;
    const uint32_t side = p->tile_run->map % s->whole_maps / s->object_count;
    *(uint8_t *)row = (uint8_t)(side < KILN_SIDES ? side : (side - KILN_SIDES) ^ 1u);
}

static void put_valid(void *row, const struct kiln_column_point *p)
{
    *(uint8_t *)row = kiln_point_valid(p->result->surface, p->own);
}

static void put_cell(void *row, const struct kiln_column_point *p) { *(uint32_t *)row = p->tile_run->cell; }

static void put_side(void *row, const struct kiln_column_point *p)
{
    *(uint8_t *)row = kiln_map_back(p->result->surface, p->tile_run->map);
}

static void put_part(void *row, const struct kiln_column_point *p)
{
    *(uint8_t *)row = (uint8_t)kiln_map_part(p->result->surface, p->tile_run->map);
}

/* Three groups: the fields of the surface follow the first group, the results follow the second. */
enum { GROUPS = 3 };
static const struct computed {
    int group;
    struct kiln_column column;
} computed[] = {
    {0,
     {.name = "/points/position",
      .early = true,
      .type = KILN_DOUBLE,
      .components = 3,
      .noisy = true,
      .units = "m",
      .description = "world position of the centroid of the part of the surface in the texel",
      .put = put_position}},
    {0,
     {.name = "/points/normal",
      .early = true,
      .type = KILN_FLOAT,
      .components = 3,
      .units = "1",
      .description = "unit shading normal there, world",
      .put = put_normal}},
    {0,
     {.name = "/points/object",
      .early = true,
      .type = KILN_UINT32,
      .components = 1,
      .units = "1",
      .description = "index into /objects",
      .put = put_object}},
    {0,
     {.name = "/points/texel",
      .early = true,
      .type = KILN_UINT32,
      .components = 2,
      .units = "texel",
      .description = "x and y in the object's lightmap, from the top left, v = 0 at the top",
      .put = put_texel}},
    {0,
     {.name = "/points/leaf",
      .early = true,
      .type = KILN_UINT32,
      .components = 3,
      .units = "1",
      .description = "x, y and z of the octree's leaf, counted from the file's leaf_origin, each leaf_size wide",
      .put = put_leaf}},
    {0,
     {.name = "/points/facing",
      .early = true,
      .type = KILN_UINT8,
      .components = 1,
      .units = "1",
      .description = "side that the surface looks to: 0 to 5 for +x, -x, +y, -y, +z, -z; each has an octree of its own",
      .put = put_facing}},
    {1,
     {.name = "/points/valid",
      .type = KILN_UINT8,
      .components = 1,
      .units = "1",
      .description =
          "1 where light could be gathered; elsewhere /irradiance is 0 and lightmaps are filled from neighbours",
      .put = put_valid}},
    {1,
     {.name = "/points/cell",
      .early = true,
      .type = KILN_UINT32,
      .components = 1,
      .units = "1",
      .description = "index into /cells",
      .put = put_cell}},
    {2,
     {.name = "/points/side",
      .early = true,
      .type = KILN_UINT8,
      .components = 1,
      .units = "1",
      .description = "0: of a front; 1: of a back, a double-sided surface seen from behind; its texels are twice as "
                     "wide as the object's unless its lightmap is published",
      .put = put_side}},
    {2,
     {.name = "/points/part",
      .early = true,
      .type = KILN_UINT8,
      .components = 1,
      .units = "1",
      .description = "0: the lightmap shows this point; 1 to 3: it is another part of a texel that walls divide",
      .put = put_part}},
};
enum { COMPUTED = sizeof computed / sizeof *computed };
static_assert((int)COMPUTED + (int)KILN_FIELDS_MAX <= (int)KILN_COLUMNS_MAX, "all columns have room");

/* ---- the columns of a bake ---- */

static void add_fields(struct kiln_columns *columns, const struct kiln_field_set *fields, bool of_surface)
{
    for (size_t i = 0; i < fields->count; i++) {
        const struct kiln_field *f = fields->entry[i].field;
        if (f->dataset != NULL && (f->life == KILN_FIELD_SURFACE) == of_surface)
            columns->column[columns->count++] = (struct kiln_column){.name = f->dataset,
                                                                     .type = KILN_FLOAT,
                                                                     .components = f->components,
                                                                     .noisy = f->noisy,
                                                                     .early = of_surface,
                                                                     .of_direct = f->of_direct,
                                                                     .units = f->unit,
                                                                     .description = f->description,
                                                                     .field = i};
    }
}

static bool is_in(const struct computed *c, bool backs, bool octree, bool parts)
{
    if (c->column.put == put_part)
        return parts;
    if (c->column.put == put_side)
        return backs;
    if (c->column.put == put_texel)
        return !octree;
    return octree || (c->column.put != put_leaf && c->column.put != put_facing);
}

void kiln_columns_make(struct kiln_columns *columns, const struct kiln_field_set *fields, bool backs, bool octree,
                       bool parts)
{
    columns->count = 0;
    for (int group = 0; group < GROUPS; group++) {
        for (size_t i = 0; i < COMPUTED; i++)
            if (computed[i].group == group && is_in(&computed[i], backs, octree, parts))
                columns->column[columns->count++] = computed[i].column;
        if (group + 1 < GROUPS)
            add_fields(columns, fields, group == 0);
    }
}

void kiln_columns_of(struct kiln_columns *columns, const struct kiln_bake_result *result)
{
    const struct kiln_surface *s = result->surface;
    kiln_columns_make(columns, result->fields, s->whole_maps > kiln_front_maps(s), s->bricks != NULL,
                      s->map_count > s->whole_maps);
}

size_t kiln_columns_find(const struct kiln_columns *columns, const char *name)
{
    size_t i = 0;
    while (i < columns->count && strcmp(columns->column[i].name, name) != 0)
        i++;
    return i;
}

size_t kiln_column_value(const struct kiln_column *column)
{
    return column->type == KILN_DOUBLE ? sizeof(double) : column->type == KILN_UINT8 ? 1 : sizeof(float);
}

size_t kiln_column_row(const struct kiln_column *column) { return column->components * kiln_column_value(column); }

size_t kiln_columns_row(const struct kiln_columns *columns)
{
    size_t bytes = 0;
    for (size_t c = 0; c < columns->count; c++)
        bytes += kiln_column_row(&columns->column[c]);
    return bytes;
}

/* ---- rows ---- */

int kiln_column_values_allocate(struct kiln_column_values *rows, const struct kiln_columns *columns, size_t count,
                                struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t c = 0; status == KILN_OK && c < columns->count; c++)
        status = kiln_allocate(&rows->column[c], count, kiln_column_row(&columns->column[c]), "points to write", error);
    return status;
}

void kiln_column_values_free(struct kiln_column_values *rows)
{
    for (int c = 0; c < KILN_COLUMNS_MAX; c++)
        kiln_free(&rows->column[c]);
}

void kiln_column_floats(const struct kiln_column *column, const struct kiln_bake_result *result,
                        struct kiln_own_point first, uint32_t points, float *floats)
{
    const struct kiln_field *field = result->fields->entry[column->field].field;
    kiln_rank_float_run(result->data, result->fields, column->field, first, points, floats);
    for (uint32_t i = 0; field->life != KILN_FIELD_SURFACE && i < points; i++)
        if (!kiln_point_valid(result->surface, (struct kiln_own_point){first.at + i}))
            memset(floats + (size_t)i * column->components, 0, column->components * sizeof *floats);
}

/* Writes rows of `points` points of a tile run, from `first` on, starting at row number `row`. The points' details are
 * known. */
static void put_points(struct kiln_column_values *rows, const struct kiln_columns *columns, uint64_t row,
                       const struct kiln_column_point *first, uint32_t points)
{
    for (size_t c = 0; c < columns->count; c++) {
        const struct kiln_column *column = &columns->column[c];
        const size_t bytes = kiln_column_row(column);
        if (rows->column[c] == NULL)
            continue;
        uint8_t *to = (uint8_t *)rows->column[c] + row * bytes;
        if (column->put == NULL) {
            kiln_column_floats(column, first->result, first->own, points, (float *)(void *)to);
            continue;
        }
        struct kiln_column_point point = *first;
        for (uint32_t i = 0; i < points; i++, point.own.at++, point.detail++, to += bytes)
            column->put(to, &point);
    }
}

/* Whether a wanted column needs the points' details, which take longer than all else. */
static bool needs_details(const struct kiln_column_values *rows, const struct kiln_columns *columns)
{
    bool needs = false;
    for (size_t c = 0; c < columns->count; c++)
        needs = needs || (rows->column[c] != NULL && columns->column[c].early && columns->column[c].put != NULL);
    return needs;
}

/* Index of the first tile run that ends after `point`. */
static size_t find_tile_run(const struct kiln_surface *s, struct kiln_global_point point)
{
    size_t low = 0, high = s->tile_run_count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (s->tile_runs[middle].first.at + s->tile_runs[middle].count <= point.at)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* A tile run on the border of two ranges is processed for both. */
void kiln_column_values_fill(struct kiln_column_values *rows, const struct kiln_columns *columns,
                             const struct kiln_bake_result *result, struct kiln_global_point first,
                             struct kiln_global_point last)
{
    const struct kiln_surface *s = result->surface;
    const bool detailed = needs_details(rows, columns);
    if (first.at >= last.at)
        return;
    const size_t from = find_tile_run(s, first), to = find_tile_run(s, (struct kiln_global_point){last.at - 1}) + 1;
#pragma omp parallel for schedule(dynamic, 64)
    for (size_t f = from; f < to; f++) {
        struct kiln_point_detail details[KILN_TILE_TEXELS];
        const struct kiln_tile_run *tile_run = &s->tile_runs[f];
        const uint32_t count = detailed ? kiln_tile_run_details(result, f, details) : tile_run->count;
        const uint64_t begin = tile_run->first.at > first.at ? tile_run->first.at : first.at,
                       end = tile_run->first.at + count < last.at ? tile_run->first.at + count : last.at;
        const struct kiln_column_point point = {result, kiln_own_of_global(s, (struct kiln_global_point){begin}),
                                                tile_run, details + (begin - tile_run->first.at)};
        put_points(rows, columns, begin - first.at, &point, (uint32_t)(end - begin));
    }
}
