#include "coordinator/generate/shape.h"

#include <stdlib.h>
#include <string.h>

#include "worker/base/memory.h"

void kiln_shape_clear(struct kiln_shape *shape)
{
    kiln_free(&shape->positions);
    kiln_free(&shape->normals);
    kiln_free(&shape->texcoord_0);
    kiln_free(&shape->charts);
    for (size_t i = 0; i < KILN_SHAPE_MATERIALS; i++)
        kiln_free(&shape->triangles[i].indices);
    memset(shape, 0, sizeof *shape);
}

static struct kiln_dvec3 unit(struct kiln_dvec3 a)
{
    const double length = dvec3_length(a);
    return length > 0 ? dvec3_scale(a, 1 / length) : a;
}

static void grow(struct kiln_shape *shape, void *pointer, size_t *capacity, size_t needed, size_t size)
{
    if (shape->status == KILN_OK)
        shape->status = kiln_grow(pointer, capacity, needed, size, "a mesh", &shape->error);
}

void kiln_shape_chart(struct kiln_shape *shape, struct kiln_dvec3 u, struct kiln_dvec3 v)
{
    grow(shape, &shape->charts, &shape->chart_capacity, shape->chart_count + 1, sizeof *shape->charts);
    if (shape->status != KILN_OK)
        return;
    shape->charts[shape->chart_count++] =
        (struct kiln_shape_chart){.u = unit(u), .v = unit(v), .vertex_first = shape->count};
}

/* Starts the chart of a face: u points from a to b, v is perpendicular to it, towards d. */
static void chart_of_face(struct kiln_shape *shape, struct kiln_dvec3 a, struct kiln_dvec3 b, struct kiln_dvec3 d)
{
    const struct kiln_dvec3 u = unit(dvec3_sub(b, a)), towards = dvec3_sub(d, a);
    kiln_shape_chart(shape, u, dvec3_sub(towards, dvec3_scale(u, dvec3_dot(u, towards))));
}

/* Adds a vertex and returns its index. Returns 0 once the shape has failed (shape->status): no memory, or too many
 * vertices. */
static uint32_t add_vertex(struct kiln_shape *shape, struct kiln_dvec3 position, struct kiln_dvec3 normal,
                           struct kiln_vec2 texcoord)
{
    if (shape->count >= UINT32_MAX && shape->status == KILN_OK)
        shape->status = kiln_fail(&shape->error, KILN_USAGE,
                                  "a mesh cannot have more than %u vertices; ask for fewer triangles", UINT32_MAX);
    grow(shape, &shape->positions, &shape->positions_capacity, shape->count + 1, sizeof *shape->positions);
    grow(shape, &shape->normals, &shape->normals_capacity, shape->count + 1, sizeof *shape->normals);
    grow(shape, &shape->texcoord_0, &shape->texcoord_capacity, shape->count + 1, sizeof *shape->texcoord_0);
    if (shape->status != KILN_OK)
        return 0;
    shape->positions[shape->count] = vec3_of(position);
    shape->normals[shape->count] = vec3_of(normal);
    shape->texcoord_0[shape->count] = texcoord;
    return (uint32_t)shape->count++;
}

static void add_triangle(struct kiln_shape *shape, uint32_t material, uint32_t a, uint32_t b, uint32_t c)
{
    const size_t count = shape->triangles[material].count;
    grow(shape, &shape->triangles[material].indices, &shape->triangles[material].capacity, count + 3, sizeof(uint32_t));
    if (shape->status != KILN_OK)
        return;
    shape->triangles[material].indices[count] = a;
    shape->triangles[material].indices[count + 1] = b;
    shape->triangles[material].indices[count + 2] = c;
    shape->triangles[material].count += 3;
}

void kiln_shape_quad(struct kiln_shape *shape, uint32_t material, struct kiln_dvec3 a, struct kiln_dvec3 b,
                     struct kiln_dvec3 c, struct kiln_dvec3 d)
{
    const struct kiln_dvec3 corners[4] = {a, b, c, d}, normal = unit(dvec3_cross(dvec3_sub(b, a), dvec3_sub(c, a)));
    static const struct kiln_vec2 texcoords[4] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    uint32_t index[4];
    for (int i = 0; i < 4; i++)
        index[i] = add_vertex(shape, corners[i], normal, texcoords[i]);
    add_triangle(shape, material, index[0], index[1], index[2]);
    add_triangle(shape, material, index[0], index[2], index[3]);
}

void kiln_shape_face(struct kiln_shape *shape, uint32_t material, struct kiln_dvec3 a, struct kiln_dvec3 b,
                     struct kiln_dvec3 c, struct kiln_dvec3 d)
{
    chart_of_face(shape, a, b, d);
    kiln_shape_quad(shape, material, a, b, c, d);
}

void kiln_shape_triangle(struct kiln_shape *shape, uint32_t material, struct kiln_dvec3 a, struct kiln_dvec3 b,
                         struct kiln_dvec3 c)
{
    const struct kiln_dvec3 corners[3] = {a, b, c}, normal = unit(dvec3_cross(dvec3_sub(b, a), dvec3_sub(c, a)));
    static const struct kiln_vec2 texcoords[3] = {{0, 0}, {1, 0}, {0, 1}};
    uint32_t index[3];
    chart_of_face(shape, a, b, c);
    for (int i = 0; i < 3; i++)
        index[i] = add_vertex(shape, corners[i], normal, texcoords[i]);
    add_triangle(shape, material, index[0], index[1], index[2]);
}

void kiln_shape_face_with_hole(struct kiln_shape *shape, uint32_t material, struct kiln_dvec3 origin,
                               struct kiln_dvec3 u, struct kiln_dvec3 v, const double hole_u[2], const double hole_v[2])
{
    const double us[4] = {0, hole_u[0], hole_u[1], 1}, vs[4] = {0, hole_v[0], hole_v[1], 1};
    struct kiln_dvec3 corners[4][4];
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            corners[i][j] = dvec3_add(origin, dvec3_add(dvec3_scale(u, us[i]), dvec3_scale(v, vs[j])));
    kiln_shape_chart(shape, u, v);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            /* beside a hole at an edge one quad is empty */
            if ((i != 1 || j != 1) && us[i] < us[i + 1] && vs[j] < vs[j + 1])
                kiln_shape_quad(shape, material, corners[i][j], corners[i + 1][j], corners[i + 1][j + 1],
                                corners[i][j + 1]);
}

void kiln_shape_box(struct kiln_shape *shape, uint32_t material, struct kiln_dvec3 low, struct kiln_dvec3 high,
                    double turn, bool inwards)
{
    static const int faces[6][4] = {{0, 1, 3, 2}, {4, 6, 7, 5}, {0, 4, 5, 1}, {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 5, 7, 3}};
    const struct kiln_dvec3 centre = dvec3_scale(dvec3_add(low, high), 0.5);
    const double c = cos(turn), s = sin(turn);
    struct kiln_dvec3 corners[8];
    for (int i = 0; i < 8; i++) { /* bit 2: x, bit 1: y, bit 0: z */
        const double x = (i & 4 ? high.x : low.x) - centre.x, z = (i & 1 ? high.z : low.z) - centre.z;
        corners[i] = turn == 0 ? dvec3(i & 4 ? high.x : low.x, i & 2 ? high.y : low.y, i & 1 ? high.z : low.z)
                               : dvec3(centre.x + c * x + s * z, i & 2 ? high.y : low.y, centre.z - s * x + c * z);
    }
    for (int i = 0; i < 6; i++)
        kiln_shape_face(shape, material, corners[faces[i][0]], corners[faces[i][inwards ? 3 : 1]], corners[faces[i][2]],
                        corners[faces[i][inwards ? 1 : 3]]);
}

static struct kiln_dvec3 surface_normal(const struct kiln_shape_surface *surface, double s, double t)
{
    const double step = 1e-5;
    /* tangents vanish at a pole, so the mean of normals on two sides a small step away is used */
    if (surface->poles && (t < step || t > 1 - step)) {
        const double inside = t < 0.5 ? 2 * step : 1 - 2 * step;
        return unit(dvec3_add(surface_normal(surface, 0, inside), surface_normal(surface, 0.5, inside)));
    }
    const double before = s - step < 0 && !surface->open ? s - step + 1 : s - step,
                 after = s + step > 1 && !surface->open ? s + step - 1 : s + step;
    const struct kiln_dvec3 along_s =
        dvec3_sub(surface->point(surface->data, after, t), surface->point(surface->data, before, t));
    const struct kiln_dvec3 along_t =
        dvec3_sub(surface->point(surface->data, s, t + step), surface->point(surface->data, s, t - step));
    return unit(dvec3_cross(along_s, along_t));
}

void kiln_shape_surface(struct kiln_shape *shape, uint32_t material, const struct kiln_shape_surface *surface)
{
    const uint32_t columns = surface->columns, rows = surface->rows;
    const uint32_t first = (uint32_t)shape->count;
    shape->curved = true;
    for (uint32_t row = 0; row <= rows && shape->status == KILN_OK; row++)
        for (uint32_t column = 0; column <= columns && shape->status == KILN_OK; column++) {
            const double s = (double)column / columns, t = (double)row / rows;
            /* a closed surface uses the same parameters on both sides of its seam, so that positions match to the last
             * bit */
            const double s_closed = column == columns && !surface->open ? 0 : s,
                         t_closed = row == rows && !surface->poles && !surface->open ? 0 : t;
            const double s_here = surface->poles && (row == 0 || row == rows) ? 0 : s_closed;
            add_vertex(shape, surface->point(surface->data, s_here, t_closed),
                       surface_normal(surface, s_here, t_closed), (struct kiln_vec2){(float)s, (float)t});
        }
    for (uint32_t row = 0; row < rows && shape->status == KILN_OK; row++)
        for (uint32_t column = 0; column < columns && shape->status == KILN_OK; column++) {
            const uint32_t a = first + row * (columns + 1) + column, b = a + 1, c = b + columns + 1,
                           d = a + columns + 1;
            if (!surface->poles || row > 0)
                add_triangle(shape, material, a, b, c);
            if (!surface->poles || row < rows - 1)
                add_triangle(shape, material, a, c, d);
        }
}

struct kiln_dvec3 kiln_shape_ellipsoid_point(const void *ellipsoid, double s, double t)
{
    const struct kiln_shape_ellipsoid *e = ellipsoid;
    const double around = 2 * KILN_PI * s, from_pole = KILN_PI * t, r = t <= 0 || t >= 1 ? 0 : sin(from_pole);
    return dvec3(e->centre.x + e->radius.x * r * cos(around), e->centre.y - e->radius.y * cos(from_pole),
                 e->centre.z - e->radius.z * r * sin(around));
}

struct kiln_dvec3 kiln_shape_torus_point(const void *torus, double s, double t)
{
    const struct kiln_shape_torus *o = torus;
    const double around = 2 * KILN_PI * s, tube = 2 * KILN_PI * t, r = o->ring + o->tube * cos(tube);
    return dvec3(o->centre.x + r * cos(around), o->centre.y + o->tube * sin(tube), o->centre.z - r * sin(around));
}

void kiln_shape_transform(struct kiln_shape *shape, double scale, struct kiln_dvec3 offset)
{
    for (size_t i = 0; i < shape->count; i++)
        shape->positions[i] = vec3_of(dvec3_add(dvec3_scale(dvec3_of(shape->positions[i]), scale), offset));
}

static int higher_first(const void *a, const void *b)
{
    const struct kiln_shape_chart *left = *(struct kiln_shape_chart *const *)a,
                                  *right = *(struct kiln_shape_chart *const *)b;
    const double by_height = (right->v_high - right->v_low) - (left->v_high - left->v_low);
    if (by_height != 0)
        return by_height < 0 ? -1 : 1;
    return left->vertex_first < right->vertex_first ? -1 : 1;
}

/* Packs the charts in rows of decreasing height into a unit square, at `scale` layout units per metre. Returns the used
 * height. */
static double fill_shelves(struct kiln_shape_chart *const *order, size_t count, double scale, double padding)
{
    double u = padding, v = padding, shelf = 0;
    for (size_t i = 0; i < count; i++) {
        const double width = (order[i]->u_high - order[i]->u_low) * scale,
                     height = (order[i]->v_high - order[i]->v_low) * scale;
        if (u + width + padding > 1 && u > padding) {
            v += shelf + padding;
            u = padding;
            shelf = 0;
        }
        if (u + width + padding > 1)
            return HUGE_VAL;
        order[i]->u_place = u;
        order[i]->v_place = v;
        u += width + padding;
        shelf = fmax(shelf, height);
    }
    return v + shelf + padding;
}

/* Finds the largest scale at which all charts fit. The padding is a fraction of the layout, as the lightmap's size is
 * not known yet; it is smaller for many charts, so that most of the square remains for the surface. */
static double pack(struct kiln_shape_chart **order, size_t count)
{
    qsort(order, count, sizeof *order, higher_first);
    const double padding = count == 1 ? 1.0 / 128 : fmin(1.0 / 64, 0.125 / sqrt((double)count));
    double widest = 0;
    for (size_t i = 0; i < count; i++)
        widest = fmax(widest, fmax(order[i]->u_high - order[i]->u_low, order[i]->v_high - order[i]->v_low));
    double low = 0, high = (1 - 2 * padding) / widest;
    if (fill_shelves(order, count, high, padding) <= 1)
        return high;
    for (int i = 0; i < 50; i++) {
        const double middle = 0.5 * (low + high);
        *(fill_shelves(order, count, middle, padding) <= 1 ? &low : &high) = middle;
    }
    (void)fill_shelves(order, count, low, padding);
    return low;
}

static size_t chart_end(const struct kiln_shape *shape, size_t chart)
{
    return chart + 1 < shape->chart_count ? shape->charts[chart + 1].vertex_first : shape->count;
}

static void measure(const struct kiln_shape *shape, size_t index)
{
    struct kiln_shape_chart *chart = &shape->charts[index];
    chart->u_low = chart->v_low = HUGE_VAL;
    chart->u_high = chart->v_high = -HUGE_VAL;
    for (size_t vertex = chart->vertex_first; vertex < chart_end(shape, index); vertex++) {
        const struct kiln_dvec3 p = dvec3_of(shape->positions[vertex]);
        const double u = dvec3_dot(chart->u, p), v = dvec3_dot(chart->v, p);
        chart->u_low = fmin(chart->u_low, u);
        chart->u_high = fmax(chart->u_high, u);
        chart->v_low = fmin(chart->v_low, v);
        chart->v_high = fmax(chart->v_high, v);
    }
}

static int lay_out(const struct kiln_shape *shape, struct kiln_vec2 **layout, struct kiln_error *error)
{
    struct kiln_shape_chart **order = NULL;
    int status = kiln_allocate(layout, shape->count, sizeof **layout, "a lightmap layout", error);
    if (status == KILN_OK)
        status = kiln_allocate(&order, shape->chart_count, sizeof *order, "a lightmap layout", error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < shape->chart_count; i++) {
        measure(shape, i);
        order[i] = &shape->charts[i];
    }
    const double scale = pack(order, shape->chart_count);
    for (size_t i = 0; i < shape->chart_count; i++) {
        const struct kiln_shape_chart *chart = &shape->charts[i];
        for (size_t vertex = chart->vertex_first; vertex < chart_end(shape, i); vertex++) {
            const struct kiln_dvec3 p = dvec3_of(shape->positions[vertex]);
            (*layout)[vertex].x = (float)(chart->u_place + scale * (dvec3_dot(chart->u, p) - chart->u_low));
            (*layout)[vertex].y = (float)(chart->v_place + scale * (dvec3_dot(chart->v, p) - chart->v_low));
        }
    }
    kiln_free(&order);
    return status;
}

static int add_materials(const struct kiln_shape *shape, struct kiln_glb *glb, struct kiln_palette *palette,
                         struct kiln_error *error)
{
    int status = KILN_OK;
    for (uint32_t i = 0; i < KILN_SHAPE_MATERIALS && status == KILN_OK; i++) {
        if (shape->triangles[i].count == 0 || (palette->added >> i & 1) != 0)
            continue;
        status = kiln_glb_add_material(glb, &palette->table[i], &palette->index[i], error);
        palette->added |= 1u << i;
    }
    return status;
}

int kiln_shape_add(struct kiln_shape *shape, struct kiln_glb *glb, const char *name, struct kiln_palette *palette,
                   uint32_t *mesh, struct kiln_error *error)
{
    struct kiln_vec2 *layout = NULL;
    uint32_t *indices = NULL;
    size_t index_count = 0;
    struct kiln_glb_primitive primitives[KILN_SHAPE_MATERIALS] = {0};
    int status = shape->status;
    if (status != KILN_OK && error != NULL)
        *error = shape->error;
    if (status == KILN_OK)
        status = add_materials(shape, glb, palette, error);
    for (size_t i = 0; i < KILN_SHAPE_MATERIALS; i++)
        index_count += shape->triangles[i].count;
    KILN_TRY(status);
    if (!shape->curved)
        KILN_TRY(lay_out(shape, &layout, error));
    KILN_TRY(kiln_allocate(&indices, index_count, sizeof *indices, "a mesh", error));
    index_count = 0;
    for (size_t i = 0; i < KILN_SHAPE_MATERIALS; i++) {
        primitives[i] = (struct kiln_glb_primitive){palette->index[i], index_count, shape->triangles[i].count};
        if (shape->triangles[i].count > 0)
            memcpy(indices + index_count, shape->triangles[i].indices, shape->triangles[i].count * sizeof *indices);
        index_count += shape->triangles[i].count;
    }
    const struct kiln_glb_mesh data = {.name = name,
                                       .vertex_count = shape->count,
                                       .positions = shape->positions,
                                       .normals = shape->normals,
                                       .texcoord_0 = shape->texcoord_0,
                                       .texcoord_1 = layout,
                                       .indices = indices,
                                       .primitives = primitives,
                                       .primitive_count = KILN_SHAPE_MATERIALS};
    KILN_TRY(kiln_glb_add_mesh(glb, &data, mesh, error));
end:
    kiln_free(&layout);
    kiln_free(&indices);
    kiln_shape_clear(shape);
    return status;
}

double kiln_shape_random(uint64_t *state)
{
    uint64_t z = *state += 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    z ^= z >> 31;
    return (double)(z >> 11) * 0x1p-53;
}
