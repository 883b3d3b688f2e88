/* Tests of lightmap layouts: meshes made here are unwrapped, and the result is checked with another rasterisation than
 * that of the layout code (clipping against each texel; point-in-triangle tests for samples). */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "coordinator/layout/layout.h"
#include "worker/base/memory.h"

/* ---- meshes ---- */

struct shape {
    struct kiln_vec3 *points;
    size_t point_count, point_capacity;
    uint32_t *corners;
    size_t corner_count, corner_capacity;
};

static uint32_t point(struct shape *s, double x, double y, double z)
{
    assert_int_equal(kiln_grow(&s->points, &s->point_capacity, s->point_count + 1, sizeof *s->points, "test", NULL),
                     KILN_OK);
    s->points[s->point_count] = vec3((float)x, (float)y, (float)z);
    return (uint32_t)s->point_count++;
}

static void triangle(struct shape *s, uint32_t a, uint32_t b, uint32_t c)
{
    assert_int_equal(kiln_grow(&s->corners, &s->corner_capacity, s->corner_count + 3, sizeof *s->corners, "test", NULL),
                     KILN_OK);
    s->corners[s->corner_count++] = a;
    s->corners[s->corner_count++] = b;
    s->corners[s->corner_count++] = c;
}

static void quad(struct shape *s, uint32_t a, uint32_t b, uint32_t c, uint32_t d)
{
    triangle(s, a, b, c);
    triangle(s, a, c, d);
}

/* A rectangle in the plane z = 0, corners counter-clockwise from (x0, y0). */
static void rectangle(struct shape *s, double x0, double y0, double x1, double y1)
{
    const uint32_t a = point(s, x0, y0, 0.0), b = point(s, x1, y0, 0.0), c = point(s, x1, y1, 0.0),
                   d = point(s, x0, y1, 0.0);
    quad(s, a, b, c, d);
}

/* The half of it below the diagonal from (x0, y1) to (x1, y0). */
static void corner(struct shape *s, double x0, double y0, double x1, double y1)
{
    const uint32_t a = point(s, x0, y0, 0.0), b = point(s, x1, y0, 0.0), c = point(s, x0, y1, 0.0);
    triangle(s, a, b, c);
}

static void free_shape(struct shape *s)
{
    kiln_free(&s->points);
    kiln_free(&s->corners);
    *s = (struct shape){0};
}

/* A grid of points over (u, v) in 0..1 x 0..1, joined by quads; the function gives the position. */
typedef void surface(double u, double v, double p[3]);
static void add_surface(struct shape *s, surface *f, uint32_t columns, uint32_t rows)
{
    const uint32_t first = (uint32_t)s->point_count;
    for (uint32_t y = 0; y <= rows; y++) {
        for (uint32_t x = 0; x <= columns; x++) {
            double p[3];
            f((double)x / columns, (double)y / rows, p);
            point(s, p[0], p[1], p[2]);
        }
    }
    for (uint32_t y = 0; y < rows; y++) {
        for (uint32_t x = 0; x < columns; x++) {
            const uint32_t a = first + y * (columns + 1) + x;
            quad(s, a, a + 1, a + columns + 2, a + columns + 1);
        }
    }
}

static void sphere(double u, double v, double p[3])
{
    /* The seam and the poles close to the bit. */
    const double a = 2.0 * KILN_PI * (u == 1.0 ? 0.0 : u), r = v == 0.0 || v == 1.0 ? 0.0 : sin(KILN_PI * v);
    p[0] = r * cos(a);
    p[1] = cos(KILN_PI * v);
    p[2] = r * sin(a);
}
static void cylinder(double u, double v, double p[3])
{
    const double a = 2.0 * KILN_PI * (u == 1.0 ? 0.0 : u);
    p[0] = cos(a);
    p[1] = -3.0 * v;
    p[2] = sin(a);
}
static void torus(double u, double v, double p[3])
{
    const double a = 2.0 * KILN_PI * (u == 1.0 ? 0.0 : u), b = 2.0 * KILN_PI * (v == 1.0 ? 0.0 : v);
    p[0] = (2.0 + 0.7 * cos(b)) * cos(a);
    p[1] = 0.7 * sin(b);
    p[2] = (2.0 + 0.7 * cos(b)) * sin(a);
}
static void moebius(double u, double v, double p[3])
{
    const double a = 2.0 * KILN_PI * u, w = 0.6 * (v - 0.5);
    p[0] = (1.0 + w * cos(0.5 * a)) * cos(a);
    p[1] = (1.0 + w * cos(0.5 * a)) * sin(a);
    p[2] = w * sin(0.5 * a);
}
/* Three turns of a ramp: all normals lie in a narrow cone, and every turn projects onto the one below. */
static void ramp(double u, double v, double p[3])
{
    const double a = 6.0 * KILN_PI * u, r = 2.0 + v;
    p[0] = r * cos(a);
    p[1] = 2.0 * u;
    p[2] = -r * sin(a);
}
static double noise(double x, double y)
{
    double sum = 0.0;
    for (int i = 0; i < 6; i++) {
        const double f = 1 << i;
        sum += sin(3.1 * f * x + 1.7 * i + 2.0 * cos(2.3 * f * y + i)) / f;
    }
    return sum;
}
static void terrain(double u, double v, double p[3])
{
    p[0] = 20.0 * u;
    p[1] = noise(u, v);
    p[2] = -20.0 * v;
}

static void add_box(struct shape *s, double x, double y, double z)
{
    uint32_t c[8];
    for (int i = 0; i < 8; i++)
        c[i] = point(s, i & 1 ? x : 0.0, i & 2 ? y : 0.0, i & 4 ? z : 0.0);
    quad(s, c[0], c[2], c[3], c[1]);
    quad(s, c[4], c[5], c[7], c[6]);
    quad(s, c[0], c[1], c[5], c[4]);
    quad(s, c[2], c[6], c[7], c[3]);
    quad(s, c[0], c[4], c[6], c[2]);
    quad(s, c[1], c[3], c[7], c[5]);
}

static uint32_t random_state = 1;
static double random_unit(void)
{
    random_state = random_state * 1664525u + 1013904223u;
    return (random_state >> 8) / 16777216.0;
}

/* ---- builders ---- */

static struct kiln_builder *new_builder(void)
{
    struct kiln_builder *b = NULL;
    uint32_t offset;
    assert_int_equal(kiln_builder_create(&b, NULL), KILN_OK);
    assert_int_equal(kiln_builder_string(b, "thing", 5, &offset, NULL), KILN_OK);
    assert_int_equal(kiln_builder_append(b, KILN_SECTION_NORMAL_MAPS, NULL, 1, NULL, NULL), KILN_OK);
    assert_int_equal(kiln_builder_append(b, KILN_SECTION_MATERIALS, NULL, 1, NULL, NULL), KILN_OK);
    return b;
}

/* Colours and base coordinates hold the vertex's number, so that copies can be told apart. */
static size_t add_mesh(struct kiln_builder *b, const struct shape *s, const struct kiln_vec2 *uv)
{
    size_t index, vertex;
    struct kiln_mesh mesh = {.vertex_first = b->sections[KILN_SECTION_POSITIONS].count,
                             .vertex_count = s->point_count,
                             .triangle_first = b->sections[KILN_SECTION_TRIANGLES].count,
                             .triangle_count = s->corner_count / 3};
    assert_int_equal(kiln_builder_append(b, KILN_SECTION_POSITIONS, s->points, s->point_count, &vertex, NULL), KILN_OK);
    assert_int_equal(kiln_builder_append(b, KILN_SECTION_NORMALS, s->points, s->point_count, NULL, NULL), KILN_OK);
    for (uint32_t i = 0; i < s->point_count; i++) {
        const struct kiln_vec2 tag = {(float)i, (float)(2 * i)};
        assert_int_equal(kiln_builder_append(b, KILN_SECTION_TEXCOORD_BASE, &tag, 1, NULL, NULL), KILN_OK);
        assert_int_equal(kiln_builder_append(b, KILN_SECTION_TEXCOORD_EMISSION, &tag, 1, NULL, NULL), KILN_OK);
        assert_int_equal(kiln_builder_append(b, KILN_SECTION_TEXCOORD_NORMAL, &tag, 1, NULL, NULL), KILN_OK);
        assert_int_equal(kiln_builder_append(b, KILN_SECTION_COLORS, &i, 1, NULL, NULL), KILN_OK);
    }
    assert_int_equal(kiln_builder_append(b, KILN_SECTION_TEXCOORD_LIGHTMAP, uv, s->point_count, NULL, NULL), KILN_OK);
    assert_int_equal(kiln_builder_append(b, KILN_SECTION_TRIANGLES, s->corners, s->corner_count / 3, NULL, NULL),
                     KILN_OK);
    assert_int_equal(kiln_builder_append(b, KILN_SECTION_TRIANGLE_MATERIALS, NULL, s->corner_count / 3, NULL, NULL),
                     KILN_OK);
    assert_int_equal(kiln_builder_append(b, KILN_SECTION_MESHES, &mesh, 1, &index, NULL), KILN_OK);
    b->mesh_has_lightmap_uv[index] = uv != NULL;
    return index;
}

static size_t add_object(struct kiln_builder *b, size_t mesh, double x, double y, double z)
{
    size_t index;
    const struct kiln_object object = {.mesh = (uint32_t)mesh, .transform = {x, 0, 0, 5, 0, y, 0, 6, 0, 0, z, 7}};
    assert_int_equal(kiln_builder_append(b, KILN_SECTION_OBJECTS, &object, 1, &index, NULL), KILN_OK);
    return index;
}

static struct kiln_object *object_of(struct kiln_builder *b, size_t index)
{
    return &KILN_BUILDER_DATA(b, struct kiln_object, KILN_SECTION_OBJECTS)[index];
}
static struct kiln_mesh *mesh_of(struct kiln_builder *b, size_t index)
{
    return &KILN_BUILDER_DATA(b, struct kiln_mesh, KILN_SECTION_MESHES)[index];
}

static bool has_note(struct kiln_builder *b, const char *part)
{
    const struct kiln_note *notes = KILN_BUILDER_DATA(b, struct kiln_note, KILN_SECTION_NOTES);
    for (size_t i = 0; i < b->sections[KILN_SECTION_NOTES].count; i++)
        if (strstr(KILN_BUILDER_DATA(b, char, KILN_SECTION_STRINGS) + notes[i].text, part) != NULL)
            return true;
    return false;
}

/* ---- checks ---- */

struct view {
    const struct kiln_vec3 *positions;
    const struct kiln_vec2 *uv;
    const uint32_t *corners;
    size_t vertex_count, triangle_count;
};

static struct view view_of(struct kiln_builder *b, size_t mesh)
{
    const struct kiln_mesh *m = mesh_of(b, mesh);
    return (struct view){KILN_BUILDER_DATA(b, struct kiln_vec3, KILN_SECTION_POSITIONS) + m->vertex_first,
                         KILN_BUILDER_DATA(b, struct kiln_vec2, KILN_SECTION_TEXCOORD_LIGHTMAP) + m->vertex_first,
                         KILN_BUILDER_DATA(b, uint32_t, KILN_SECTION_TRIANGLES) + 3 * m->triangle_first,
                         m->vertex_count, m->triangle_count};
}

static double area_of(const struct view *v, size_t t, const double scale[3])
{
    struct kiln_dvec3 p[3];
    for (int k = 0; k < 3; k++) {
        const struct kiln_vec3 q = v->positions[v->corners[3 * t + (size_t)k]];
        p[k] = dvec3((double)q.x * scale[0], (double)q.y * scale[1], (double)q.z * scale[2]);
    }
    return 0.5 * dvec3_length(dvec3_cross(dvec3_sub(p[1], p[0]), dvec3_sub(p[2], p[0])));
}

static void corners_of(const struct view *v, size_t t, double width, double height, double p[3][2])
{
    for (int k = 0; k < 3; k++) {
        const struct kiln_vec2 c = v->uv[v->corners[3 * t + (size_t)k]];
        p[k][0] = width * (double)c.x;
        p[k][1] = height * (double)c.y;
    }
}

static double signed_area(double p[3][2])
{
    return 0.5 * ((p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[1][1] - p[0][1]) * (p[2][0] - p[0][0]));
}

/* Whether the triangle and the texel, shrunk by 0.002, have a point in common: the triangle is clipped to its four
 * sides. */
static bool touches(double p[3][2], double x, double y)
{
    const double bounds[4] = {x + 0.002, x + 0.998, y + 0.002, y + 0.998};
    double a[8][2], b[8][2];
    int count = 3;
    memcpy(a, p, 6 * sizeof(double));
    for (int side = 0; side < 4; side++) {
        const int axis = side / 2, other = 1 - axis;
        const double bound = bounds[side], sign = side % 2 == 0 ? 1.0 : -1.0;
        int kept = 0;
        for (int i = 0; i < count; i++) {
            const double *s = a[i], *e = a[(i + 1) % count];
            const double ds = sign * (s[axis] - bound), de = sign * (e[axis] - bound);
            if (ds >= 0.0)
                memcpy(b[kept++], s, 2 * sizeof(double));
            if ((ds < 0.0) != (de < 0.0)) {
                b[kept][axis] = bound;
                b[kept++][other] = s[other] + (e[other] - s[other]) * ds / (ds - de);
            }
        }
        count = kept;
        memcpy(a, b, sizeof a);
    }
    return count > 0;
}

static bool covers(double p[3][2], double x, double y)
{
    const double sign = signed_area(p) < 0.0 ? -1.0 : 1.0;
    for (int k = 0; k < 3; k++) {
        const double *a = p[k], *b = p[(k + 1) % 3];
        if (sign * ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) <= 1e-9)
            return false;
    }
    return true;
}

static uint32_t find_root(uint32_t *root, uint32_t i)
{
    while (root[i] != i)
        i = root[i] = root[root[i]];
    return i;
}

struct placed {
    struct kiln_vec2 uv;
    uint32_t vertex;
};
static int compare_placed(const void *a, const void *b)
{
    const struct placed *p = a, *q = b;
    if (p->uv.x != q->uv.x)
        return p->uv.x < q->uv.x ? -1 : 1;
    return p->uv.y < q->uv.y ? -1 : p->uv.y > q->uv.y;
}

/* A chart's number for each vertex: triangles that meet in a point of the layout are of one chart. */
static uint32_t *chart_numbers(const struct view *v)
{
    uint32_t *root = calloc(v->vertex_count + 1, sizeof *root);
    struct placed *placed = calloc(v->vertex_count + 1, sizeof *placed);
    assert_non_null(root);
    assert_non_null(placed);
    for (uint32_t i = 0; i < v->vertex_count; i++) {
        root[i] = i;
        placed[i] = (struct placed){v->uv[i], i};
    }
    for (size_t t = 0; t < 3 * v->triangle_count; t++)
        root[find_root(root, v->corners[t])] = find_root(root, v->corners[t - t % 3]);
    qsort(placed, v->vertex_count, sizeof *placed, compare_placed);
    for (size_t i = 1; i < v->vertex_count; i++)
        if (compare_placed(&placed[i - 1], &placed[i]) == 0)
            root[find_root(root, placed[i].vertex)] = find_root(root, placed[i - 1].vertex);
    for (uint32_t i = 0; i < v->vertex_count; i++)
        root[i] = find_root(root, i);
    free(placed);
    return root;
}

static void clipped_range(double a, double b, double c, uint32_t size, uint32_t *first, uint32_t *end)
{
    *first = (uint32_t)fmax(floor(fmin(a, fmin(b, c))), 0.0);
    *end = (uint32_t)fmin(floor(fmax(a, fmax(b, c))) + 1.0, size);
}

/* No texel and no sample (16 a texel) belongs to two charts; texels of different charts are more than `padding` apart.
 */
static void check_charts_apart(const struct view *v, uint32_t width, uint32_t height, int padding)
{
    uint32_t *chart = chart_numbers(v), *owner = calloc((size_t)width * height, sizeof *owner);
    assert_non_null(owner);
    for (size_t t = 0; t < v->triangle_count; t++) {
        double p[3][2];
        corners_of(v, t, width, height, p);
        if (signed_area(p) == 0.0)
            continue;
        uint32_t x0, x1, y0, y1;
        clipped_range(p[0][0], p[1][0], p[2][0], width, &x0, &x1);
        clipped_range(p[0][1], p[1][1], p[2][1], height, &y0, &y1);
        const uint32_t own = chart[v->corners[3 * t]] + 1;
        for (uint32_t y = y0; y < y1; y++) {
            for (uint32_t x = x0; x < x1; x++) {
                if (!touches(p, x, y))
                    continue;
                uint32_t *o = &owner[(size_t)y * width + x];
                assert_true(*o == 0 || *o == own);
                *o = own;
            }
        }
    }
    for (int y = 0; y < (int)height; y++) {
        for (int x = 0; x < (int)width; x++) {
            const uint32_t own = owner[y * (int)width + x];
            if (own == 0)
                continue;
            assert_true(padding == 0 || (x > 0 && y > 0 && x + 1 < (int)width && y + 1 < (int)height));
            for (int dy = 0; dy <= padding && y + dy < (int)height; dy++) {
                for (int dx = -padding; dx <= padding; dx++) {
                    if (x + dx < 0 || x + dx >= (int)width)
                        continue;
                    const uint32_t other = owner[(y + dy) * (int)width + x + dx];
                    assert_true(other == 0 || other == own);
                }
            }
        }
    }
    free(owner);
    free(chart);
}

static void check_samples_once(const struct view *v, uint32_t width, uint32_t height)
{
    uint8_t *taken = calloc((size_t)width * height * 16, 1);
    assert_non_null(taken);
    for (size_t t = 0; t < v->triangle_count; t++) {
        double p[3][2];
        corners_of(v, t, 4.0 * width, 4.0 * height, p);
        uint32_t x0, x1, y0, y1;
        clipped_range(p[0][0], p[1][0], p[2][0], 4 * width, &x0, &x1);
        clipped_range(p[0][1], p[1][1], p[2][1], 4 * height, &y0, &y1);
        for (uint32_t y = y0; y < y1; y++) {
            for (uint32_t x = x0; x < x1; x++) {
                if (!covers(p, x + 0.4321, y + 0.5678))
                    continue;
                assert_int_equal(taken[(size_t)y * 4 * width + x], 0);
                taken[(size_t)y * 4 * width + x] = 1;
            }
        }
    }
    free(taken);
}

struct quality {
    double use;             /* share of the lightmap that is covered */
    double ratio[2];        /* least and largest texels a m2 of a triangle, over the mean; slivers left out */
    double mean_area_error; /* |uv share / area share - 1|, weighted by area */
    size_t charts;
};

static struct quality quality_of(const struct view *v, uint32_t width, uint32_t height, const double scale[3])
{
    struct quality q = {.ratio = {INFINITY, 0.0}};
    double area = 0.0, texels = 0.0;
    for (size_t t = 0; t < v->triangle_count; t++) {
        double p[3][2];
        corners_of(v, t, width, height, p);
        area += area_of(v, t, scale);
        texels += fabs(signed_area(p));
    }
    for (size_t t = 0; t < v->triangle_count; t++) {
        double p[3][2];
        corners_of(v, t, width, height, p);
        const double own = area_of(v, t, scale);
        if (own == 0.0)
            continue;
        const double ratio = fabs(signed_area(p)) / own * area / texels;
        q.mean_area_error += fabs(ratio - 1.0) * own / area;
        /* Float coordinates limit how well the smallest triangles can come out. */
        if (fabs(signed_area(p)) > 1e-2) {
            q.ratio[0] = fmin(q.ratio[0], ratio);
            q.ratio[1] = fmax(q.ratio[1], ratio);
        }
    }
    q.use = texels / ((double)width * height);
    uint32_t *chart = chart_numbers(v);
    for (uint32_t i = 0; i < v->vertex_count; i++)
        q.charts += chart[i] == i;
    free(chart);
    return q;
}

/* Coordinates of base colour, emission and normal map, colours and normals still belong to their vertex, and triangles
 * to their old corners. */
static void check_vertices(struct kiln_builder *b, size_t mesh, const struct shape *s)
{
    const struct kiln_mesh *m = mesh_of(b, mesh);
    const struct view v = view_of(b, mesh);
    const struct kiln_vec2 *base = KILN_BUILDER_DATA(b, struct kiln_vec2, KILN_SECTION_TEXCOORD_BASE) + m->vertex_first;
    const struct kiln_vec2 *emission =
        KILN_BUILDER_DATA(b, struct kiln_vec2, KILN_SECTION_TEXCOORD_EMISSION) + m->vertex_first;
    const struct kiln_vec2 *normal =
        KILN_BUILDER_DATA(b, struct kiln_vec2, KILN_SECTION_TEXCOORD_NORMAL) + m->vertex_first;
    const struct kiln_vec3 *normals = KILN_BUILDER_DATA(b, struct kiln_vec3, KILN_SECTION_NORMALS) + m->vertex_first;
    const uint8_t *colors = KILN_BUILDER_DATA(b, uint8_t, KILN_SECTION_COLORS) + 4 * m->vertex_first;
    assert_int_equal(m->triangle_count, s->corner_count / 3);
    for (size_t i = 0; i < 3 * m->triangle_count; i++) {
        const uint32_t now = v.corners[i], old = s->corners[i];
        uint32_t color;
        assert_true(now < m->vertex_count);
        memcpy(&color, colors + 4 * now, 4);
        assert_int_equal(color, old);
        assert_memory_equal(&v.positions[now], &s->points[old], sizeof *s->points);
        assert_memory_equal(&normals[now], &s->points[old], sizeof *s->points);
        assert_true(base[now].x == (float)old && emission[now].y == (float)(2 * old));
        assert_memory_equal(&normal[now], &base[now], sizeof *base);
        assert_true(v.uv[now].x >= 0.0f && v.uv[now].x <= 1.0f && v.uv[now].y >= 0.0f && v.uv[now].y <= 1.0f);
    }
    static const enum kiln_scene_section sections[] = {
        KILN_SECTION_NORMALS,           KILN_SECTION_TEXCOORD_BASE, KILN_SECTION_TEXCOORD_EMISSION,
        KILN_SECTION_TEXCOORD_LIGHTMAP, KILN_SECTION_COLORS,        KILN_SECTION_TEXCOORD_NORMAL};
    for (size_t i = 0; i < sizeof sections / sizeof *sections; i++)
        assert_int_equal(b->sections[sections[i]].count, b->sections[KILN_SECTION_POSITIONS].count);
}

/* Bounds that a layout must keep. */
struct bounds {
    double use, least_ratio, largest_ratio;
    size_t charts;
};

/* Lays a shape out alone and checks everything. */
static struct quality check_shape(const char *name, const struct shape *s, struct kiln_layout_params params,
                                  struct bounds bounds)
{
    struct kiln_builder *b = new_builder();
    const size_t mesh = add_mesh(b, s, NULL), object = add_object(b, mesh, 1.0, 1.0, 1.0);
    struct kiln_error error = {""};
    static const double scale[3] = {1.0, 1.0, 1.0};
    if (kiln_layout(b, &params, &error) != KILN_OK)
        fail_msg("%s: %s", name, error.message);
    const uint32_t width = object_of(b, object)->lightmap_width, height = object_of(b, object)->lightmap_height;
    const struct view v = view_of(b, mesh);
    const struct quality q = quality_of(&v, width, height, scale);
    print_message("%-18s %7zu triangles %6zu charts %4u x %-4u at %.3g a metre used %4.1f %%  texels a m2 %.3f to %.3f "
                  "of the mean, %.2f %% off in the mean\n",
                  name, v.triangle_count, q.charts, width, height, (double)b->texels_per_metre, 100.0 * q.use,
                  q.ratio[0], q.ratio[1], 100.0 * q.mean_area_error);
    check_vertices(b, mesh, s);
    check_charts_apart(&v, width, height, params.padding == 0 ? 2 : (int)params.padding);
    check_samples_once(&v, width, height);
    assert_true(mesh_of(b, mesh)->flags & KILN_MESH_UNWRAPPED);
    assert_true(fabs(mesh_of(b, mesh)->uv_area - q.use) < 1e-6);
    assert_true(q.use >= bounds.use);
    assert_true(q.ratio[0] >= bounds.least_ratio);
    assert_true(q.ratio[1] <= bounds.largest_ratio);
    assert_true(q.charts <= bounds.charts);
    kiln_builder_destroy(&b);
    return q;
}

static void test_box(void **state)
{
    (void)state;
    struct shape s = {0};
    add_box(&s, 1.0, 2.0, 0.5);
    check_shape("box", &s, (struct kiln_layout_params){.texels_per_metre = 40.0}, (struct bounds){0.6, 0.99, 1.01, 6});
    check_shape("box, coarse", &s, (struct kiln_layout_params){.texels_per_metre = 3.3},
                (struct bounds){0.1, 0.6, 1.7, 6});
    check_shape("box, 64 x 64", &s, (struct kiln_layout_params){.lightmap_size = 64},
                (struct bounds){0.5, 0.9, 1.12, 6});
    check_shape("box, padding 5", &s, (struct kiln_layout_params){.texels_per_metre = 64.0, .padding = 5},
                (struct bounds){0.5, 0.99, 1.01, 6});
    free_shape(&s);
}

static void test_round(void **state)
{
    (void)state;
    struct shape s = {0};
    add_surface(&s, sphere, 64, 32);
    check_shape("sphere", &s, (struct kiln_layout_params){0}, (struct bounds){0.55, 0.7, 1.3, 30});
    check_shape("sphere, coarse", &s, (struct kiln_layout_params){.texels_per_metre = 5.0},
                (struct bounds){0.2, 0.7, 1.3, 30});
    free_shape(&s);
    add_surface(&s, cylinder, 48, 10);
    check_shape("cylinder", &s, (struct kiln_layout_params){0}, (struct bounds){0.7, 0.7, 1.3, 10});
    free_shape(&s);
    add_surface(&s, torus, 96, 32);
    check_shape("torus", &s, (struct kiln_layout_params){0}, (struct bounds){0.55, 0.7, 1.3, 60});
    free_shape(&s);
}

static void test_overlapping_projection(void **state)
{
    (void)state;
    struct shape s = {0};
    add_surface(&s, ramp, 90, 2);
    const struct quality q =
        check_shape("ramp", &s, (struct kiln_layout_params){0}, (struct bounds){0.4, 0.8, 1.2, 12});
    assert_true(q.charts >= 3);
    free_shape(&s);
    add_surface(&s, moebius, 60, 4);
    check_shape("moebius", &s, (struct kiln_layout_params){0}, (struct bounds){0.5, 0.7, 1.3, 20});
    free_shape(&s);
}

static void test_slivers(void **state)
{
    (void)state;
    struct shape s = {0};
    for (int i = 0; i <= 1000; i++) {
        point(&s, 0.001 * i, 0.0, 0.0);
        point(&s, 0.001 * i, 0.0, -10.0);
    }
    for (uint32_t i = 0; i < 1000; i++)
        quad(&s, 2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1);
    check_shape("slivers", &s, (struct kiln_layout_params){0}, (struct bounds){0.9, 0.9, 1.1, 1});
    free_shape(&s);
    rectangle(&s, 0.0, 0.0, 100.0, 0.01);
    check_shape("ribbon", &s, (struct kiln_layout_params){.texels_per_metre = 10.0},
                (struct bounds){0.01, 0.9, 1.1, 1});
    free_shape(&s);
}

static void test_soup(void **state)
{
    (void)state;
    struct shape s = {0};
    for (int i = 0; i < 1000; i++) {
        const double x = 10.0 * random_unit(), y = 10.0 * random_unit(), z = 10.0 * random_unit();
        uint32_t c[3];
        for (int k = 0; k < 3; k++)
            c[k] = point(&s, x + random_unit(), y + random_unit(), z + random_unit());
        triangle(&s, c[0], c[1], c[2]);
    }
    check_shape("soup", &s, (struct kiln_layout_params){.texels_per_metre = 32.0},
                (struct bounds){0.4, 0.99, 1.01, 1000});
    check_shape("soup, coarse", &s, (struct kiln_layout_params){.texels_per_metre = 3.0},
                (struct bounds){0.05, 0.99, 1.01, 1000});
    check_shape("soup, 512 x 512", &s, (struct kiln_layout_params){.lightmap_size = 512},
                (struct bounds){0.35, 0.99, 1.01, 1000});
    free_shape(&s);
}

static void test_single(void **state)
{
    (void)state;
    struct shape s = {0};
    corner(&s, 0.0, 0.0, 2.0, 3.0);
    check_shape("single", &s, (struct kiln_layout_params){.texels_per_metre = 30.0},
                (struct bounds){0.4, 0.999, 1.001, 1});
    check_shape("single, tiny", &s, (struct kiln_layout_params){.texels_per_metre = 0.01},
                (struct bounds){0.0, 0.999, 1.001, 1});
    free_shape(&s);
}

static void test_terrain(void **state)
{
    (void)state;
    struct shape s = {0};
    add_surface(&s, terrain, 250, 200);
    check_shape("terrain", &s, (struct kiln_layout_params){0}, (struct bounds){0.5, 0.6, 1.4, 2000});
    free_shape(&s);
}

/* Duplicates, three sheets at one edge, and triangles without area, all in one mesh. */
static void test_broken(void **state)
{
    (void)state;
    struct shape s = {0};
    add_box(&s, 1.0, 1.0, 1.0);
    add_box(&s, 1.0, 1.0, 1.0);   /* every triangle twice, from other vertices */
    quad(&s, 0, 1, 3, 2);         /* and one side a third time, from behind */
    for (int i = 0; i < 5; i++) { /* five sheets at one edge */
        const uint32_t c = point(&s, 1.0, cos(i), sin(i)), d = point(&s, 0.0, cos(i), sin(i));
        quad(&s, 0, 1, c, d);
    }
    triangle(&s, 0, 0, 1);
    triangle(&s, 2, 2, 2);
    corner(&s, 0.5, 0.0, 1.0, 0.0);
    corner(&s, 9.0, 9.0, 9.0, 9.0);
    point(&s, 1e6, 0, 0); /* used by nothing */
    check_shape("broken", &s, (struct kiln_layout_params){.texels_per_metre = 40.0},
                (struct bounds){0.55, 0.99, 1.01, 18});
    free_shape(&s);
    corner(&s, 0.0, 0.0, 1.0, 0.0);
    struct kiln_builder *b = new_builder();
    const size_t mesh = add_mesh(b, &s, NULL), object = add_object(b, mesh, 1.0, 1.0, 1.0);
    assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){0}, NULL), KILN_OK);
    check_vertices(b, mesh, &s);
    assert_int_equal(object_of(b, object)->lightmap_width, 1);
    assert_int_equal(object_of(b, object)->lightmap_height, 1);
    kiln_builder_destroy(&b);
    free_shape(&s);
}

/* More charts than a lightmap has texels still gives an answer, with a warning. */
static void test_too_many_charts(void **state)
{
    (void)state;
    struct shape s = {0};
    for (int i = 0; i < 500; i++)
        corner(&s, i, 0.0, i + 0.5, 1.0);
    struct kiln_builder *b = new_builder();
    const size_t mesh = add_mesh(b, &s, NULL), object = add_object(b, mesh, 1.0, 1.0, 1.0);
    struct kiln_error error = {""};
    assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){.lightmap_max = 16, .texels_per_metre = 10.0}, &error),
                     KILN_OK);
    check_vertices(b, mesh, &s);
    const struct view v = view_of(b, mesh);
    check_samples_once(&v, 64, 64);
    assert_true(object_of(b, object)->lightmap_width <= 16 && object_of(b, object)->lightmap_height <= 16);
    assert_true(has_note(b, "share texels"));
    kiln_builder_destroy(&b);
    b = new_builder();
    add_object(b, add_mesh(b, &s, NULL), 1.0, 1.0, 1.0);
    assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){.lightmap_size = 1}, &error), KILN_OK);
    assert_int_equal(object_of(b, 0)->lightmap_width, 1);
    kiln_builder_destroy(&b);
    free_shape(&s);
}

/* ---- the second UV set ---- */

static const struct kiln_vec2 good_uv[4] = {{0.1f, 0.1f}, {0.9f, 0.1f}, {0.9f, 0.5f}, {0.1f, 0.5f}};

static struct shape two_by_one(void)
{
    struct shape s = {0};
    rectangle(&s, 0.0, 0.0, 2.0, 1.0);
    return s;
}

static void check_verdict(const struct kiln_vec2 uv[4], const char *reason)
{
    struct shape s = two_by_one();
    struct kiln_builder *b = new_builder();
    const size_t mesh = add_mesh(b, &s, uv), object = add_object(b, mesh, 1.0, 1.0, 1.0);
    assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){.texels_per_metre = 32.0}, NULL), KILN_OK);
    if (reason == NULL) {
        const struct view v = view_of(b, mesh);
        assert_int_equal(mesh_of(b, mesh)->flags & KILN_MESH_UNWRAPPED, 0);
        assert_int_equal(b->sections[KILN_SECTION_NOTES].count, 0);
        assert_int_equal(v.vertex_count, 4);
        for (int i = 0; i < 4; i++)
            assert_true(fabsf(v.uv[i].x - uv[i].x) <= 1e-4f && v.uv[i].x >= 0.0f && v.uv[i].x <= 1.0f);
        /* 2 m over 0.8, 1 m over 0.4 */
        assert_true(abs((int)object_of(b, object)->lightmap_width - 80) <= (uv == good_uv ? 0 : 1));
        assert_int_equal(object_of(b, object)->lightmap_height, 80);
    } else {
        assert_int_not_equal(mesh_of(b, mesh)->flags & KILN_MESH_UNWRAPPED, 0);
        assert_true(has_note(b, reason) && has_note(b, "mesh \"thing\""));
        assert_int_equal(object_of(b, object)->lightmap_width * object_of(b, object)->lightmap_height, 66 * 34);
    }
    check_vertices(b, mesh, &s);
    kiln_builder_destroy(&b);
    free_shape(&s);
}

static void test_second_uv_set(void **state)
{
    (void)state;
    check_verdict(good_uv, NULL);
    const struct kiln_vec2 edge[4] = {{-0.00005f, 0.1f}, {0.79995f, 0.1f}, {0.79995f, 0.5f}, {-0.00005f, 0.5f}};
    check_verdict(edge, NULL);
    const struct kiln_vec2 folded[4] = {{0.1f, 0.1f}, {0.9f, 0.1f}, {0.9f, 0.5f}, {0.85f, 0.15f}};
    check_verdict(folded, "overlaps itself");
    const struct kiln_vec2 outside[4] = {{0.1f, 0.1f}, {1.9f, 0.1f}, {1.9f, 0.5f}, {0.1f, 0.5f}};
    check_verdict(outside, "leaves 0..1: vertex 1 is at (1.9, 0.1)");
    const struct kiln_vec2 infinite[4] = {{0.1f, 0.1f}, {0.9f, 0.1f}, {0.9f, INFINITY}, {0.1f, 0.5f}};
    check_verdict(infinite, "leaves 0..1");
    const struct kiln_vec2 nothing[4] = {{0.1f, 0.1f}, {NAN, 0.1f}, {0.9f, 0.5f}, {0.1f, 0.5f}};
    check_verdict(nothing, "leaves 0..1");
    const struct kiln_vec2 spot[4] = {{0.5f, 0.5f}, {0.5f, 0.5f}, {0.5f, 0.5f}, {0.5f, 0.5f}};
    check_verdict(spot, "collapsed for 100 %");
    const struct kiln_vec2 half[4] = {{0.1f, 0.1f}, {0.9f, 0.1f}, {0.9f, 0.5f}, {0.5f, 0.3f}};
    check_verdict(half, "collapsed for 50 %");
    const struct kiln_vec2 small[4] = {{0.5f, 0.5f}, {0.51f, 0.5f}, {0.51f, 0.51f}, {0.5f, 0.51f}};
    check_verdict(small, "uses only 0.01 %");
}

/* A grid whose charts share 0.1 % of their samples, as rounding at seams gives, passes; with 2 % it passes with a
 * warning, but charts are packed anew, since they share whole texels; with 5 % it does not. */
static void test_overlap_tolerance(void **state)
{
    (void)state;
    static const double extra[3] = {0.0001, 0.002, 0.005};
    for (int grade = 0; grade < 3; grade++) {
        struct shape s = {0};
        struct kiln_vec2 uv[40];
        for (int i = 0; i < 10; i++) {
            rectangle(&s, i, 0.0, i + 1.0, 10.0);
            const float low = (float)(0.1 * i), high = (float)fmin(0.1 * (i + 1) + extra[grade], 1.0);
            uv[4 * i] = (struct kiln_vec2){low, 0.0f};
            uv[4 * i + 1] = (struct kiln_vec2){high, 0.0f};
            uv[4 * i + 2] = (struct kiln_vec2){high, 1.0f};
            uv[4 * i + 3] = (struct kiln_vec2){low, 1.0f};
        }
        struct kiln_builder *b = new_builder();
        const size_t mesh = add_mesh(b, &s, uv);
        add_object(b, mesh, 1.0, 1.0, 1.0);
        assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){0}, NULL), KILN_OK);
        assert_int_equal(has_note(b, "overlaps itself"), grade > 0);
        assert_int_equal(has_note(b, "used as they are"), grade == 1);
        assert_int_equal((mesh_of(b, mesh)->flags & KILN_MESH_UNWRAPPED) != 0, grade > 0);
        assert_int_equal((mesh_of(b, mesh)->flags & KILN_MESH_REPACKED) != 0, grade == 1);
        assert_int_equal(has_note(b, "would share texels"), grade == 1);
        kiln_builder_destroy(&b);
        free_shape(&s);
    }
}

/* ---- sizes ---- */

static void test_sizes(void **state)
{
    (void)state;
    struct shape s = two_by_one();
    struct kiln_builder *b = new_builder();
    const size_t mesh = add_mesh(b, &s, good_uv);
    add_object(b, mesh, 1.0, 1.0, 1.0);
    add_object(b, mesh, 3.0, 1.0, 1.0);   /* stretched along u */
    add_object(b, mesh, -1.0, 2.0, 1.0);  /* mirrored, stretched along v */
    add_object(b, mesh, 100.0, 1.0, 1.0); /* too large for the cap */
    add_object(b, mesh, 0.0, 0.0, 0.0);   /* no area */
    assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){.texels_per_metre = 32.0, .lightmap_max = 500}, NULL),
                     KILN_OK);
    static const uint32_t expected[5][2] = {{80, 80}, {240, 80}, {80, 160}, {500, 80}, {1, 1}};
    for (size_t i = 0; i < 5; i++) {
        assert_int_equal(object_of(b, i)->lightmap_width, expected[i][0]);
        assert_int_equal(object_of(b, i)->lightmap_height, expected[i][1]);
    }
    assert_true(has_note(b, "larger than 500 texels a side"));
    assert_true(b->texels_per_metre == 32.0f);
    kiln_builder_destroy(&b);
    b = new_builder();
    add_object(b, add_mesh(b, &s, good_uv), 1.0, 1.0, 1.0);
    add_object(b, add_mesh(b, &s, NULL), 7.0, 1.0, 1.0);
    assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){.lightmap_size = 48}, NULL), KILN_OK);
    for (size_t i = 0; i < 2; i++) {
        assert_int_equal(object_of(b, i)->lightmap_width, 48);
        assert_int_equal(object_of(b, i)->lightmap_height, 48);
    }
    assert_true(b->texels_per_metre == 0.0f);
    kiln_builder_destroy(&b);
    free_shape(&s);
}

/* The default density gives about 2^18 texels whatever the scene's size. */
static void test_default_density(void **state)
{
    (void)state;
    static const double scales[] = {1e-6, 0.3, 1.0, 77.0, 1e6};
    struct shape s = {0};
    add_box(&s, 1.0, 2.0, 3.0);
    for (size_t i = 0; i < sizeof scales / sizeof *scales; i++) {
        struct kiln_builder *b = new_builder();
        const size_t mesh = add_mesh(b, &s, NULL);
        for (int k = 0; k < 3; k++)
            add_object(b, mesh, scales[i], scales[i], scales[i]);
        assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){0}, NULL), KILN_OK);
        double texels = 0.0;
        for (size_t k = 0; k < 3; k++)
            texels += (double)object_of(b, k)->lightmap_width * object_of(b, k)->lightmap_height;
        print_message("scale %g: %g texels a metre, %g texels\n", scales[i], (double)b->texels_per_metre, texels);
        assert_true(texels > 262144.0 / 1.7 && texels < 262144.0 * 1.7);
        kiln_builder_destroy(&b);
    }
    free_shape(&s);
}

/* A ground plane 2 km wide, a house and 60 things of 1 to 40 cm in it: `grounds` of the large ones. */
static struct kiln_builder *plain_scene(const struct shape *floor, const struct shape *box, int grounds, int things,
                                        const struct kiln_vec2 *uv)
{
    struct kiln_builder *b = new_builder();
    const size_t plane = add_mesh(b, floor, uv), cube = add_mesh(b, box, NULL);
    for (int i = 0; i < grounds; i++)
        add_object(b, plane, 1000.0, 1000.0, 1000.0);
    for (int i = 0; i < things; i++)
        add_object(b, cube, 0.01 + 0.0065 * i, 0.01 + 0.0065 * i, 0.01 + 0.0065 * i);
    return b;
}

static double texels_of(struct kiln_builder *b, size_t object)
{
    return (double)object_of(b, object)->lightmap_width * (double)object_of(b, object)->lightmap_height;
}

static double all_texels(struct kiln_builder *b)
{
    double sum = 0.0;
    for (size_t i = 0; i < b->sections[KILN_SECTION_OBJECTS].count; i++)
        sum += texels_of(b, i);
    return sum;
}

/* Automatic density: no object has more than a quarter of all texels, or with fewer than four objects an even part;
 * none is less than 8 texels across; the sum is near 2^18; equal objects have equal lightmaps; what the user says of an
 * object counts. */
static void test_shares(void **state)
{
    (void)state;
    struct shape floor = two_by_one(), box = {0};
    add_box(&box, 1.0, 1.0, 1.0);
    for (int made = 0; made < 2; made++) { /* with a layout of its own, and unwrapped */
        for (int things = 1; things <= 60; things = 3 * things + 1) {
            struct kiln_builder *b = plain_scene(&floor, &box, 2, things, made == 0 ? good_uv : NULL);
            assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){0}, NULL), KILN_OK);
            const double all = all_texels(b), most = all * fmax(0.25, 1.0 / (things + 2));
            print_message("%d things: %g texels, the grounds have %.1f %%\n", things, all,
                          100.0 * texels_of(b, 0) / all);
            assert_true(all > 262144.0 / 1.5 && all < 262144.0 * 1.5);
            for (size_t i = 0; i < (size_t)things + 2; i++) {
                assert_true(texels_of(b, i) <= 1.03 * most && (things + 2 < 4 || texels_of(b, i) <= 0.25 * all));
                assert_true(object_of(b, i)->lightmap_width >= 8 || object_of(b, i)->lightmap_height >= 8);
            }
            assert_true(texels_of(b, 0) == texels_of(b, 1));
            if (things > 20) {
                assert_int_equal(object_of(b, 0)->density_reason, KILN_DENSITY_FRACTION);
                assert_int_equal(object_of(b, (size_t)things + 1)->density_reason, KILN_DENSITY_COMMON);
                assert_true(has_note(b, "of all texels at the density of the others"));
            }
            kiln_builder_destroy(&b);
        }
    }
    struct kiln_builder *b = plain_scene(&floor, &box, 1, 40, good_uv);
    const size_t last = 40;
    assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){0}, NULL), KILN_OK);
    const double side = object_of(b, last)->lightmap_width, ground = texels_of(b, 0);
    kiln_builder_destroy(&b);
    b = plain_scene(&floor, &box, 1, 40, good_uv);
    b->object_settings[0].lightmap_size = 77;
    b->object_settings[last].density_scale = 2.0;
    b->object_settings[last - 1].role = KILN_ROLE_CASTER_ONLY;
    assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){.texels_per_metre = 300.0}, NULL), KILN_OK);
    assert_true(texels_of(b, 0) == 77.0 * 77.0 && ground != 77.0 * 77.0 && side > 0.0);
    assert_int_equal(object_of(b, 0)->density_reason, KILN_DENSITY_SIZED);
    assert_int_equal(object_of(b, last)->density_reason, KILN_DENSITY_SCALED);
    assert_int_equal(object_of(b, last - 1)->density_reason, KILN_DENSITY_CASTER);
    /* 300 a metre on a cube of 0.2635 m: 79 texels an edge; twice that; the one before is a little smaller and has a
     * quarter */
    const double edge = 0.01 + 0.0065 * 39;
    assert_true(fabs(sqrt(texels_of(b, last) * mesh_of(b, 1)->uv_area / 6.0) / (600.0 * edge) - 1.0) < 0.02);
    assert_true(fabs(sqrt(texels_of(b, last - 1) * mesh_of(b, 1)->uv_area / 6.0) / (75.0 * (edge - 0.0065)) - 1.0) <
                    0.02 ||
                object_of(b, last - 1)->lightmap_width == (object_of(b, last)->lightmap_width + 1) / 2);
    kiln_builder_destroy(&b);
    free_shape(&floor);
    free_shape(&box);
}

/* Automatic density: no object has twice the density of the largest one, be it small or one of few; unless that one is
 * vast. */
static void test_largest(void **state)
{
    (void)state;
    static const double floors[] = {2.0, 20.0, 200.0, 20000.0}, things[] = {1.0, 0.6, 0.1};
    struct shape floor = two_by_one(), box = {0};
    add_box(&box, 1.0, 1.0, 1.0);
    for (size_t f = 0; f < sizeof floors / sizeof *floors; f++) {
        struct kiln_builder *b = new_builder();
        const size_t plane = add_mesh(b, &floor, good_uv);
        add_object(b, plane, floors[f], floors[f], floors[f]);
        for (int k = 1; k <= 2; k++) { /* what stands around: else the floor would be ground */
            const size_t post = add_object(b, add_mesh(b, &box, NULL), 0.01, 0.01, 0.01);
            struct kiln_object *o = &KILN_BUILDER_DATA(b, struct kiln_object, KILN_SECTION_OBJECTS)[post];
            o->transform[3] = o->transform[7] = o->transform[11] = 0.4 * k * floors[f];
        }
        for (size_t i = 0; i < 3;
             i++) /* a mesh each: instances cannot be less than half as fine as their mesh's layout */
            add_object(b, add_mesh(b, &box, NULL), things[i], things[i], things[i]);
        assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){0}, NULL), KILN_OK);
        const double ground = sqrt(texels_of(b, 0) * mesh_of(b, plane)->uv_area / 2.0) / floors[f];
        for (size_t i = 0; i < 3; i++) {
            const double own = sqrt(texels_of(b, i + 3) * mesh_of(b, plane + 3 + i)->uv_area / 6.0) / things[i];
            print_message("%g m, %g m: %g and %g texels a metre\n", floors[f], things[i], ground, own);
            /* a cube has a texel for each face, whatever the density */
            assert_true(own <= 2.0 * ground || floors[f] > 1000.0 || own * things[i] < 4.0);
            assert_true(floors[f] < 1000.0 || i > 0 || own > 100.0 * ground);
        }
        kiln_builder_destroy(&b);
    }
    free_shape(&floor);
    free_shape(&box);
}

/* Instances of very different size and shape: the padding stays, the largest has the density asked for. */
static void test_instances(void **state)
{
    (void)state;
    struct shape s = {0};
    add_box(&s, 1.0, 1.0, 1.0);
    struct kiln_builder *b = new_builder();
    const size_t mesh = add_mesh(b, &s, NULL);
    add_object(b, mesh, 0.01, 0.01, 0.01);
    add_object(b, mesh, 10.0, 4.0, 0.2);
    add_object(b, mesh, 5.0, 2.0, 0.1);
    add_object(b, mesh, 4.0, 4.0, 4.0);
    assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){.texels_per_metre = 20.0}, NULL), KILN_OK);
    const struct view v = view_of(b, mesh);
    static const double largest[3] = {4.0, 4.0, 4.0};
    const struct kiln_object *o = object_of(b, 3);
    const struct quality q = quality_of(&v, o->lightmap_width, o->lightmap_height, largest);
    assert_true(q.ratio[0] > 0.99 && q.ratio[1] < 1.01 && q.use > 0.6);
    assert_true(fabs(q.use * (double)o->lightmap_width * (double)o->lightmap_height - 96.0 * 400.0) < 1.0);
    check_charts_apart(&v, o->lightmap_width, o->lightmap_height, 2);
    for (size_t i = 0; i < 3; i++) {
        const struct kiln_object *small = object_of(b, i);
        assert_true(2 * small->lightmap_width >= o->lightmap_width && 2 * small->lightmap_height >= o->lightmap_height);
        check_charts_apart(&v, small->lightmap_width, small->lightmap_height, 0);
    }
    kiln_builder_destroy(&b);
    b = new_builder();
    add_object(b, add_mesh(b, &s, NULL), 10.0, 4.0, 0.2);
    assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){.texels_per_metre = 20.0}, NULL), KILN_OK);
    const struct view wall = view_of(b, 0);
    static const double scale[3] = {10.0, 4.0, 0.2};
    const struct quality w =
        quality_of(&wall, object_of(b, 0)->lightmap_width, object_of(b, 0)->lightmap_height, scale);
    assert_true(w.ratio[0] > 0.99 && w.ratio[1] < 1.01);
    kiln_builder_destroy(&b);
    free_shape(&s);
}

/* Several meshes, some with a good second set: ranges stay contiguous, layouts are the same on every run. */
static void test_many_meshes(void **state)
{
    (void)state;
    struct shape s[3] = {{0}, two_by_one(), {0}};
    add_surface(&s[0], sphere, 24, 12);
    add_box(&s[2], 3.0, 1.0, 2.0);
    struct kiln_builder *run[2];
    for (int i = 0; i < 2; i++) {
        struct kiln_builder *b = run[i] = new_builder();
        for (int k = 0; k < 3; k++)
            add_object(b, add_mesh(b, &s[k], k == 1 ? good_uv : NULL), 1.0, 1.0, 1.0);
        add_mesh(b, &s[2], NULL); /* no object shows it */
        assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){0}, NULL), KILN_OK);
        uint64_t vertex = 0;
        for (size_t k = 0; k < 4; k++) {
            check_vertices(b, k, &s[k % 3 == 0 && k > 0 ? 2 : k]);
            assert_int_equal(mesh_of(b, k)->vertex_first, vertex);
            vertex += mesh_of(b, k)->vertex_count;
        }
        assert_int_equal(vertex, b->sections[KILN_SECTION_POSITIONS].count);
        assert_true(has_note(b, "3 of 4 meshes have no second UV set"));
    }
    for (int section = 0; section < KILN_SECTION_COUNT; section++) {
        assert_int_equal(run[0]->sections[section].count, run[1]->sections[section].count);
        if (run[0]->sections[section].count > 0)
            assert_memory_equal(run[0]->sections[section].data, run[1]->sections[section].data,
                                run[0]->sections[section].count *
                                    kiln_scene_element_size((enum kiln_scene_section)section));
    }
    for (int i = 0; i < 2; i++)
        kiln_builder_destroy(&run[i]);
    for (int k = 0; k < 3; k++)
        free_shape(&s[k]);
}

static void test_parameters(void **state)
{
    (void)state;
    struct shape s = two_by_one();
    struct kiln_builder *b = new_builder();
    add_object(b, add_mesh(b, &s, NULL), 1.0, 1.0, 1.0);
    struct kiln_error error = {""};
    assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){.texels_per_metre = NAN}, &error), KILN_USAGE);
    assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){.texels_per_metre = -1.0}, &error), KILN_USAGE);
    assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){.lightmap_max = 1u << 20}, &error), KILN_USAGE);
    assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){.padding = 1000}, &error), KILN_USAGE);
    assert_non_null(strstr(error.message, "1000"));
    kiln_builder_destroy(&b);
    free_shape(&s);
    b = new_builder();
    assert_int_equal(kiln_layout(b, &(struct kiln_layout_params){0}, &error), KILN_OK);
    assert_true(b->texels_per_metre > 0.0f);
    kiln_builder_destroy(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_box),
        cmocka_unit_test(test_round),
        cmocka_unit_test(test_overlapping_projection),
        cmocka_unit_test(test_slivers),
        cmocka_unit_test(test_soup),
        cmocka_unit_test(test_single),
        cmocka_unit_test(test_terrain),
        cmocka_unit_test(test_broken),
        cmocka_unit_test(test_too_many_charts),
        cmocka_unit_test(test_second_uv_set),
        cmocka_unit_test(test_overlap_tolerance),
        cmocka_unit_test(test_sizes),
        cmocka_unit_test(test_default_density),
        cmocka_unit_test(test_largest),
        cmocka_unit_test(test_shares),
        cmocka_unit_test(test_instances),
        cmocka_unit_test(test_many_meshes),
        cmocka_unit_test(test_parameters),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
