/* The rows of kiln bench stability. The standard scene is a closed box of 2 m whose inner walls emit L and reflect rho,
 * so that E = pi L / (1 - rho) on them, and above it a black floor of 2 m under a lamp that faces it. Of the lamp, a
 * polygon with corners r_i as seen from a point of the floor,
 *
 *     E = L/2 |sum over edges of  angle(r_i, r_i+1)  n . (r_i x r_i+1) / |r_i x r_i+1||
 *
 * (Lambert, "Photometria", 1760). */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/bench/stability.h"
#include "coordinator/output/image.h"
#include "coordinator/output/read/results.h"
#include "worker/base/memory.h"

static const double PI = 3.14159265358979323846;

enum { WALLS = 6, FLOOR = 6, LAMP = 7 }; /* objects of the standard scene; without the box the floor is object 0 */

struct setup {
    double vertex_scale; /* 0: 1 */
    double linear[3][3]; /* by the nodes; all 0: the identity */
    double shift[3];     /* by the nodes, m */
    double radiance;     /* 0: 1 */
    double lamp, height; /* m; 0: 1 */
    bool open;           /* without the box */
    const char *const *options;
};

static const char *const no_options[] = {NULL};

static int finish(struct kiln_row_found *found, bool holds, const char *format, double a, double b)
{
    found->holds = holds;
    (void)snprintf(found->measured, sizeof found->measured, format, a, b);
    return KILN_OK;
}

/* Bakes; a bake that fails is what was found: *done is false then. */
static int bake(struct kiln_trial *t, const char *const *options, struct kiln_row_found *found, bool *done)
{
    const int status = kiln_trial_bake(t, options);
    *done = status == KILN_OK && t->code == KILN_OK;
    if (status != KILN_OK || *done)
        return status;
    const char *sentence = strstr(t->said, "error: ");
    found->holds = false;
    (void)snprintf(found->measured, sizeof found->measured, "exit code %d: %.120s", t->code,
                   sentence != NULL ? sentence + strlen("error: ") : t->said);
    found->measured[strcspn(found->measured, "\n")] = '\0';
    return KILN_OK;
}

/* ---- the standard scene ---- */

static struct kiln_dvec3 times(const double m[3][3], struct kiln_dvec3 p)
{
    return dvec3(m[0][0] * p.x + m[0][1] * p.y + m[0][2] * p.z, m[1][0] * p.x + m[1][1] * p.y + m[1][2] * p.z,
                 m[2][0] * p.x + m[2][1] * p.y + m[2][2] * p.z);
}

static bool has_linear(const struct setup *s)
{
    static const double none[3][3] = {{0}};
    return memcmp(s->linear, none, sizeof none) != 0;
}

static double or_one(double value) { return value != 0.0 ? value : 1.0; }

/* Where a corner of the standard scene is in the world, but for the shift. */
static struct kiln_dvec3 placed(const struct setup *s, struct kiln_dvec3 corner)
{
    const struct kiln_dvec3 p = dvec3_scale(corner, or_one(s->vertex_scale));
    return has_linear(s) ? times(s->linear, p) : p;
}

static struct kiln_glb_placement placement_of(const struct setup *s)
{
    struct kiln_glb_placement placement = {0};
    if (!has_linear(s)) {
        memcpy(placement.translation, s->shift, sizeof s->shift);
        return placement;
    }
    for (size_t c = 0; c < 3; c++) {
        for (size_t r = 0; r < 3; r++)
            placement.matrix[4 * c + r] = s->linear[r][c];
        placement.matrix[12 + c] = s->shift[c];
    }
    placement.matrix[15] = 1.0;
    return placement;
}

static void add_quad(struct kiln_trial *t, const struct setup *s, const struct kiln_dvec3 corner[4], unsigned cut,
                     uint32_t material)
{
    struct kiln_dvec3 at[4];
    const struct kiln_glb_placement placement = placement_of(s);
    for (int i = 0; i < 4; i++)
        at[i] = dvec3_scale(corner[i], or_one(s->vertex_scale));
    kiln_trial_quad(t, at, cut, material, &placement);
}

/* A box with its fronts inside, one object a wall. */
static void add_box(struct kiln_trial *t, const struct setup *s, struct kiln_dvec3 low, struct kiln_dvec3 high,
                    uint32_t material)
{
    static const unsigned char faces[WALLS][4] = {{4, 6, 7, 5}, {1, 3, 2, 0}, {5, 7, 3, 1},
                                                  {0, 2, 6, 4}, {6, 2, 3, 7}, {0, 4, 5, 1}}; /* bits: x 1, y 2, z 4 */
    for (int f = 0; f < WALLS; f++) {
        struct kiln_dvec3 corner[4];
        for (int i = 0; i < 4; i++) {
            const unsigned bits = faces[f][i];
            corner[i] = dvec3((bits & 1) != 0 ? high.x : low.x, (bits & 2) != 0 ? high.y : low.y,
                              (bits & 4) != 0 ? high.z : low.z);
        }
        add_quad(t, s, corner, 0, material);
    }
}

static void floor_corners(struct kiln_dvec3 corner[4])
{
    corner[0] = dvec3(-1, 0, 1), corner[1] = dvec3(1, 0, 1), corner[2] = dvec3(1, 0, -1), corner[3] = dvec3(-1, 0, -1);
}

/* A lamp over the middle of the floor, of these half sides. */
static void lamp_corners(double half_x, double half_z, double height, struct kiln_dvec3 corner[4])
{
    corner[0] = dvec3(-half_x, height, -half_z), corner[1] = dvec3(half_x, height, -half_z);
    corner[2] = dvec3(half_x, height, half_z), corner[3] = dvec3(-half_x, height, half_z);
}

static void setup_lamp(const struct setup *s, struct kiln_dvec3 corner[4])
{
    const double half = 0.5 * or_one(s->lamp);
    lamp_corners(half, half, or_one(s->height), corner);
}

static void make_standard(struct kiln_trial *t, const struct setup *s)
{
    struct kiln_dvec3 floor[4], lamp[4];
    const double radiance = or_one(s->radiance);
    floor_corners(floor);
    setup_lamp(s, lamp);
    kiln_trial_scene(t);
    if (!s->open)
        add_box(t, s, dvec3(-1, -3, -1), dvec3(1, -1, 1), kiln_trial_material(t, 0.5, radiance));
    add_quad(t, s, floor, 0, kiln_trial_material(t, 0, 0));
    add_quad(t, s, lamp, 0, kiln_trial_material(t, 0, radiance));
}

/* ---- closed forms ---- */

static double lambert(const struct kiln_dvec3 corner[4], struct kiln_dvec3 place, struct kiln_dvec3 normal)
{
    double sum = 0.0;
    for (int i = 0; i < 4; i++) {
        const struct kiln_dvec3 a = dvec3_sub(corner[i], place), b = dvec3_sub(corner[(i + 1) % 4], place),
                                edge = dvec3_cross(a, b);
        const double length = dvec3_length(edge);
        if (length > 0.0)
            sum += atan2(length, dvec3_dot(a, b)) * dvec3_dot(normal, edge) / length;
    }
    return 0.5 * fabs(sum);
}

/* The mean of that over a texel, whose middle and sides these are. */
static double lambert_over(const struct kiln_dvec3 lamp[4], struct kiln_dvec3 middle, const struct kiln_dvec3 side[2],
                           struct kiln_dvec3 normal)
{
    enum { CUTS = 4 };
    double sum = 0.0;
    for (int i = 0; i < CUTS * CUTS; i++) {
        const double u = (i % CUTS + 0.5) / CUTS - 0.5, v = (i / CUTS + 0.5) / CUTS - 0.5;
        const struct kiln_dvec3 place = dvec3_add(middle, dvec3_add(dvec3_scale(side[0], u), dvec3_scale(side[1], v)));
        sum += lambert(lamp, place, normal);
    }
    return sum / (CUTS * CUTS);
}

/* Root of the mean square of the relative error of the floor's direct light, against a lamp of radiance `unit` with
 * these corners. The floor is this object and has `texels` a side. 1e9 where there is no point or a value that is no
 * number. */
static double floor_error(const struct kiln_trial *t, uint32_t object, const struct setup *s,
                          const struct kiln_dvec3 lamp[4], double unit, double texels)
{
    struct kiln_dvec3 floor[4], at[4];
    double sum = 0.0;
    size_t count = 0;
    floor_corners(floor);
    for (int i = 0; i < 4; i++) {
        floor[i] = placed(s, floor[i]);
        at[i] = placed(s, lamp[i]);
    }
    const struct kiln_dvec3 side[2] = {dvec3_scale(dvec3_sub(floor[1], floor[0]), 1.0 / texels),
                                       dvec3_scale(dvec3_sub(floor[3], floor[0]), 1.0 / texels)},
                            across = dvec3_cross(side[0], side[1]),
                            normal = dvec3_scale(across, 1.0 / dvec3_length(across));
    for (size_t i = 0; i < t->point_count; i++) {
        const struct kiln_trial_point *p = &t->points[i];
        if (p->object != object)
            continue;
        const struct kiln_dvec3 middle =
            dvec3(p->position[0] - s->shift[0], p->position[1] - s->shift[1], p->position[2] - s->shift[2]);
        const double off = (double)p->direct[1] / unit / lambert_over(at, middle, side, normal) - 1.0;
        sum += off * off;
        count++;
    }
    return count > 0 && isfinite(sum) ? sqrt(sum / (double)count) : 1e9;
}

/* The largest relative error of the walls' means. */
static double walls_error(const struct kiln_trial *t, uint32_t first, double want)
{
    double worst = 0.0;
    for (uint32_t i = first; i < first + WALLS; i++) {
        const double off = fabs(kiln_trial_mean(t, i) / want - 1.0);
        worst = off <= worst ? worst : isfinite(off) ? off : 1e9;
    }
    return worst;
}

/* ---- rows of the standard scene ---- */

static int run_standard(struct kiln_trial *t, const struct kiln_row *row, const struct setup *s,
                        struct kiln_row_found *found)
{
    bool done;
    struct kiln_dvec3 lamp[4];
    const double radiance = or_one(s->radiance);
    setup_lamp(s, lamp);
    make_standard(t, s);
    const int status = bake(t, s->options != NULL ? s->options : no_options, found, &done);
    if (!done)
        return status;
    const double floor = floor_error(t, s->open ? 0 : FLOOR, s, lamp, radiance, 16),
                 walls = s->open ? 0.0 : walls_error(t, 0, 2.0 * PI * radiance);
    return finish(found, floor <= row->tolerance && walls <= row->tolerance,
                  s->open ? "floor off by %.3g %%" : "floor off by %.3g %%, furnace by %.3g %%", 100.0 * floor,
                  100.0 * walls);
}

static int run_scale(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    return run_standard(t, row, &(struct setup){.vertex_scale = row->x}, found);
}

static int run_scale_node(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    return run_standard(t, row, &(struct setup){.linear = {{row->x, 0, 0}, {0, row->x, 0}, {0, 0, row->x}}}, found);
}

static int run_translation(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    return run_standard(t, row, &(struct setup){.shift = {row->x, -row->x, 0.5 * row->x}}, found);
}

static int run_shear(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    static const char *const options[] = {"--samples-direct", "2048", NULL};
    const struct setup s = {.linear = {{1, row->x, 0}, {0, 1, 0}, {0, 0.3 * row->x, 1}}, .options = options};
    return run_standard(t, row, &s, found);
}

static int run_mirror(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    return run_standard(t, row, &(struct setup){.linear = {{row->x, 0, 0}, {0, 1, 0}, {0, 0, 1}}}, found);
}

static int run_radiance(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    return run_standard(t, row, &(struct setup){.radiance = row->x}, found);
}

static int run_lamp(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    return run_standard(t, row, &(struct setup){.lamp = row->x, .open = true}, found);
}

static int run_distance(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    return run_standard(t, row, &(struct setup){.lamp = 4, .height = row->x, .open = true}, found);
}

static int run_few_samples(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    static const char *const options[] = {
        "--samples-direct", "1", "--samples-bounce", "1", "--samples-indirect", "1", "--lightmap-size", "64", NULL};
    bool done;
    kiln_trial_scene(t);
    add_box(t, &(struct setup){0}, dvec3(-1, -1, -1), dvec3(1, 1, 1), kiln_trial_material(t, 0.5, 1));
    const int status = bake(t, options, found, &done);
    if (!done)
        return status;
    const double walls = walls_error(t, 0, 2.0 * PI);
    return finish(found, walls <= row->tolerance, "a wall's mean off by %.3g %%", 100.0 * walls, 0.0);
}

static int run_many_samples(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    static const char *const options[] = {
        "--samples-direct", "1000000", "--samples-indirect", "1000000", "--lightmap-size", "1", NULL};
    bool done;
    kiln_trial_scene(t);
    add_box(t, &(struct setup){0}, dvec3(-1, -1, -1), dvec3(1, 1, 1), kiln_trial_material(t, 0.5, 1));
    const int status = bake(t, options, found, &done);
    if (!done)
        return status;
    const double walls = walls_error(t, 0, 2.0 * PI);
    return finish(found, walls <= row->tolerance, "a wall off by %.3g %%", 100.0 * walls, 0.0);
}

/* ---- maps ---- */

static int run_one_texel(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    static const char *const options[] = {"--lightmap-size", "1", "--samples-direct", "4096", NULL};
    enum { SIDE = 64 };
    bool done;
    double want = 0.0;
    const struct setup s = {0};
    struct kiln_dvec3 lamp[4];
    setup_lamp(&s, lamp);
    make_standard(t, &s);
    const int status = bake(t, options, found, &done);
    if (!done)
        return status;
    for (int i = 0; i < SIDE * SIDE; i++)
        want +=
            lambert(lamp, dvec3((i % SIDE + 0.5) * 2 / SIDE - 1, 0, (i / SIDE + 0.5) * 2 / SIDE - 1), dvec3(0, 1, 0)) /
            (SIDE * SIDE);
    const double floor = fabs(kiln_trial_mean(t, FLOOR) / want - 1.0), walls = walls_error(t, 0, 2.0 * PI);
    return finish(found, floor <= row->tolerance && walls <= row->tolerance, "floor off by %.3g %%, furnace by %.3g %%",
                  100.0 * floor, 100.0 * walls);
}

/* A floor of 16384 x 16384 texels, whose halves cover two opposite corners of its layout, 1/64 of its sides each. */
static int run_largest_map(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    static const char *const options[] = {
        "--lightmap-size", "16384", "--lightmap-max", "16384", "--objects", "{object1: {lightmap-size: 16}}", NULL};
    static const struct kiln_vec3 corner[8] = {{-1, 0, 1}, {0, 0, 1}, {0, 0, -1}, {-1, 0, -1},
                                               {0, 0, 1},  {1, 0, 1}, {1, 0, -1}, {0, 0, -1}};
    static const uint32_t indices[12] = {0, 1, 2, 0, 2, 3, 4, 5, 6, 4, 6, 7};
    const float high = 0.015625f;
    const struct kiln_vec2 layout[8] = {{0, high},     {high, high}, {high, 0},        {0, 0},
                                        {1 - high, 1}, {1, 1},       {1, 1.0f - high}, {1 - high, 1.0f - high}};
    const struct setup s = {.open = true};
    struct kiln_dvec3 lamp[4];
    bool done;
    setup_lamp(&s, lamp);
    kiln_trial_scene(t);
    kiln_trial_mesh(t, corner, layout, 8, indices, 12, kiln_trial_material(t, 0, 0), NULL);
    add_quad(t, &s, lamp, 0, kiln_trial_material(t, 0, 1));
    const int status = bake(t, options, found, &done);
    if (!done)
        return status;
    const double off = floor_error(t, 0, &s, lamp, 1.0, 256);
    return finish(found, off <= row->tolerance, "floor off by %.3g %%", 100.0 * off, 0.0);
}

/* The mean of a lightmap's green; below 0 if it cannot be read. */
static double map_mean(const struct kiln_trial *t, const char *name)
{
    static const char *const wanted[] = {"G"};
    struct kiln_results *results = NULL;
    struct kiln_image *image = NULL;
    double sum = -1.0;
    int status = kiln_results_open(&results, t->result, NULL);
    if (status == KILN_OK)
        status = kiln_results_image(results, name, wanted, 1, &image, NULL);
    if (status == KILN_OK) {
        const size_t count = (size_t)image->width * image->height;
        sum = 0.0;
        for (size_t i = 0; i < count; i++)
            sum += (double)image->channels[0].values[i] / (double)count;
    }
    kiln_image_destroy(&image);
    kiln_results_close(&results);
    return sum;
}

static int run_half(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    static const char *const options[] = {"--half", NULL};
    bool done;
    make_standard(t, &(struct setup){.radiance = row->x});
    const int status = bake(t, options, found, &done);
    if (!done)
        return status;
    const double off = map_mean(t, "lightmaps/object0.exr") / kiln_trial_mean(t, 0) - 1.0;
    return finish(found, fabs(off) <= row->tolerance, "a wall's map off by %.3g %%", 100.0 * off, 0.0);
}

/* ---- what must be the same ---- */

static double largest_difference(const struct kiln_trial_point *a, const struct kiln_trial_point *b, size_t count)
{
    double worst = 0.0;
    for (size_t i = 0; i < count; i++) {
        if (a[i].object != b[i].object || memcmp(a[i].texel, b[i].texel, sizeof a[i].texel) != 0)
            return 1e9;
        for (int c = 0; c < 3; c++)
            worst = fmax(worst, fabs((double)a[i].direct[c] - (double)b[i].direct[c]) +
                                    fabs((double)a[i].indirect[c] - (double)b[i].indirect[c]));
    }
    return worst;
}

static int run_cells(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    char size[32];
    const char *const options[] = {"--cell-size", size, NULL};
    struct kiln_trial_point *points = NULL;
    size_t count = 0;
    double worst = 1e9;
    bool done;
    make_standard(t, &(struct setup){0});
    int status = bake(t, no_options, found, &done);
    if (done) {
        points = t->points;
        count = t->point_count;
        t->points = NULL;
        (void)snprintf(size, sizeof size, "%g", row->x);
        status = bake(t, options, found, &done);
    }
    if (done && count == t->point_count)
        worst = largest_difference(points, t->points, count);
    if (done)
        status = finish(found, !(worst > row->tolerance), "E differs by %.3g W/m2 at most", worst, 0.0);
    kiln_free(&points);
    return status;
}

/* ---- furnaces ---- */

static int run_furnace(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    bool done;
    kiln_trial_scene(t);
    add_box(t, &(struct setup){0}, dvec3(-1, -1, -1), dvec3(1, 1, 1), kiln_trial_material(t, row->x, 1));
    const int status = bake(t, no_options, found, &done);
    if (!done)
        return status;
    if (row->x < 1.0) {
        const double walls = walls_error(t, 0, PI / (1.0 - row->x));
        return finish(found, walls <= row->tolerance, "a wall's mean off by %.3g %%", 100.0 * walls, 0.0);
    }
    const bool diverges = json_is_true(json_object_get(json_object_get(t->report, "tail"), "diverges"));
    const bool said = kiln_trial_says(t, "diverge");
    return finish(found, diverges && said,
                  diverges && said ? "tail.diverges, and a note" : "not said, or only in one place", 0.0, 0.0);
}

static int run_flat_furnace(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    bool done;
    kiln_trial_scene(t);
    add_box(t, &(struct setup){0}, dvec3(-1, -0.5 * row->x, -1), dvec3(1, 0.5 * row->x, 1),
            kiln_trial_material(t, 0.5, 1));
    const int status = bake(t, no_options, found, &done);
    if (!done)
        return status;
    const double walls = walls_error(t, 0, 2.0 * PI);
    return finish(found, walls <= row->tolerance, "a wall's mean off by %.3g %%", 100.0 * walls, 0.0);
}

/* ---- triangles ---- */

/* A floor whose middle is two triangles 2 m long and 2 m / x wide. */
static int run_slivers(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    enum { ROWS = 4 };
    const double depth[ROWS] = {1, 1 / row->x, -1 / row->x, -1};
    const struct setup s = {.open = true};
    struct kiln_vec3 corner[2 * ROWS];
    struct kiln_vec2 layout[2 * ROWS];
    uint32_t indices[6 * (ROWS - 1)];
    struct kiln_dvec3 lamp[4];
    bool done;
    for (uint32_t i = 0; i < 2 * ROWS; i++) {
        corner[i] = vec3(i % 2 != 0 ? 1 : -1, 0, (float)depth[i / 2]);
        layout[i] = (struct kiln_vec2){i % 2 != 0 ? 1.0f : 0.0f, 0.5f + 0.5f * corner[i].z};
    }
    for (uint32_t i = 0; i + 1 < ROWS; i++) {
        const uint32_t a = 2 * i, quad[6] = {a, a + 1, a + 3, a, a + 3, a + 2};
        memcpy(indices + 6 * i, quad, sizeof quad);
    }
    setup_lamp(&s, lamp);
    kiln_trial_scene(t);
    kiln_trial_mesh(t, corner, layout, 2 * ROWS, indices, 6 * (ROWS - 1), kiln_trial_material(t, 0, 0), NULL);
    add_quad(t, &s, lamp, 0, kiln_trial_material(t, 0, 1));
    const int status = bake(t, no_options, found, &done);
    if (!done)
        return status;
    const double off = floor_error(t, 0, &s, lamp, 1.0, 16);
    return finish(found, off <= row->tolerance, "floor off by %.3g %%", 100.0 * off, 0.0);
}

static int run_nan(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    struct kiln_dvec3 corner[4];
    (void)row;
    floor_corners(corner);
    corner[2].y = (double)NAN;
    kiln_trial_scene(t);
    add_quad(t, &(struct setup){0}, corner, 0, kiln_trial_material(t, 0.5, 1));
    const int status = kiln_trial_bake(t, no_options);
    if (status != KILN_OK)
        return status;
    const bool said = kiln_trial_says(t, "error: ") && kiln_trial_says(t, "vertex 2");
    return finish(found, t->code == KILN_BAD_INPUT && said,
                  said ? "exit code %.0f, and a sentence that names the vertex" : "exit code %.0f, no sentence",
                  t->code, 0.0);
}

/* Two sheets that face away from one another divide a furnace. `towards`: which is the first; `cut`: the diagonal of
 * the second. */
static int coincident(struct kiln_trial *t, const struct kiln_row *row, int towards, unsigned cut,
                      struct kiln_row_found *found)
{
    static const struct kiln_dvec3 sheet[2][4] = {{{0, -1, 1}, {0, -1, -1}, {0, 1, -1}, {0, 1, 1}},
                                                  {{0, -1, -1}, {0, -1, 1}, {0, 1, 1}, {0, 1, -1}}};
    bool done;
    double off = 0.0;
    const struct setup s = {0};
    kiln_trial_scene(t);
    const uint32_t wall = kiln_trial_material(t, 0.5, 1);
    add_box(t, &s, dvec3(-1, -1, -1), dvec3(1, 1, 1), wall);
    add_quad(t, &s, sheet[towards], 0, wall);
    add_quad(t, &s, sheet[1 - towards], cut, wall);
    const int status = bake(t, no_options, found, &done);
    if (!done)
        return status;
    for (uint32_t i = 0; i < WALLS + 2; i++)
        off = fmax(off, fabs(kiln_trial_mean(t, i) / (2.0 * PI) - 1.0));
    const json_t *energy = json_object_get(t->report, "energy");
    const double blocked = json_number_value(json_array_get(json_object_get(energy, "blocked"), 1)) /
                           json_number_value(json_array_get(json_object_get(energy, "emitted"), 1));
    return finish(found, off <= row->tolerance && blocked <= 1e-6,
                  "an object off by %.3g %%, %.2g of the light is lost", 100.0 * off, blocked);
}

/* x: 0 and 1 are the two orders; 2 and 3 the same with other diagonals. */
static int run_coincident(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    const int which = (int)row->x;
    return coincident(t, row, which % 2, which / 2 == 0 ? 1 : 0, found);
}

/* Two floors in one place that face the same way, under a lamp. */
static int run_doubled(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    const struct setup s = {.open = true};
    struct kiln_dvec3 floor[4], lamp[4];
    bool done;
    floor_corners(floor);
    setup_lamp(&s, lamp);
    kiln_trial_scene(t);
    const uint32_t black = kiln_trial_material(t, 0, 0);
    add_quad(t, &s, floor, 0, black);
    add_quad(t, &s, floor, (unsigned)row->x, black);
    add_quad(t, &s, lamp, 0, kiln_trial_material(t, 0, 1));
    const int status = bake(t, no_options, found, &done);
    if (!done)
        return status;
    const double off = fmax(floor_error(t, 0, &s, lamp, 1.0, 16), floor_error(t, 1, &s, lamp, 1.0, 16));
    const bool said = kiln_trial_says(t, "'object0' and 'object1'");
    return finish(found, off <= row->tolerance && said,
                  said ? "a floor off by %.3g %%; a note names both" : "a floor off by %.3g %%, nothing is said",
                  100.0 * off, 0.0);
}

/* ---- lights ---- */

static int run_strip(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    static const char *const options[] = {"--samples-direct", "256", "--lightmap-size", "24", NULL};
    const struct setup s = {.open = true};
    struct kiln_dvec3 floor[4], lamp[4];
    bool done;
    floor_corners(floor);
    lamp_corners(0.5 * row->x, 50, 1, lamp);
    for (int i = 0; i < 4; i++)
        lamp[i].x = (double)(float)(lamp[i].x + 0.1);
    kiln_trial_scene(t);
    add_quad(t, &s, floor, 0, kiln_trial_material(t, 0, 0));
    add_quad(t, &s, lamp, 0, kiln_trial_material(t, 0, 1));
    const int status = bake(t, options, found, &done);
    if (!done)
        return status;
    const double off = floor_error(t, 0, &s, lamp, 1.0, 24);
    return finish(found, off <= row->tolerance, "floor off by %.3g %%", 100.0 * off, 0.0);
}

/* A point light over the middle of the floor, x m high: the floor takes I times the solid angle in which it is seen,
 * 4 atan(a2 / (h sqrt(2 a2 + h2))) of a square of half side a. */
static int run_point(struct kiln_trial *t, const struct kiln_row *row, struct kiln_row_found *found)
{
    const double h = row->x, solid_angle = 4.0 * atan(1.0 / (h * sqrt(2.0 + h * h))), intensity = 1.0 + h * h;
    const struct setup s = {0};
    struct kiln_dvec3 floor[4];
    bool done;
    floor_corners(floor);
    kiln_trial_scene(t);
    add_quad(t, &s, floor, 0, kiln_trial_material(t, 0, 0));
    kiln_trial_light(t, intensity, dvec3(0.01, h, 0.02));
    const int status = bake(t, no_options, found, &done);
    if (!done)
        return status;
    const double off = kiln_trial_mean(t, 0) * 4.0 / (intensity * solid_angle) - 1.0;
    const bool said = kiln_trial_says(t, "'object0' has a point or spot light");
    return finish(found, fabs(off) <= row->tolerance || said,
                  said ? "off by %+.3g %%; a note names the object" : "all light off by %+.3g %%", 100.0 * off, 0.0);
}

#define SAME_FORM "closed forms of floor and furnace, within 1 %"
#define FLOOR_FORM "closed form at each texel, within 1 % rms"
#define FURNACE_FORM "E = pi L / (1 - albedo), within 0.3 %"

const struct kiln_row kiln_rows[] = {
    {"scale", "vertices times 1e-8", SAME_FORM, 1e-8, 0.01, run_scale, false},
    {"scale", "vertices times 1e-4", SAME_FORM, 1e-4, 0.01, run_scale, false},
    {"scale", "vertices as they are", SAME_FORM, 1, 0.01, run_scale, false},
    {"scale", "vertices times 1e5", SAME_FORM, 1e5, 0.01, run_scale, false},
    {"scale", "vertices times 1e10", SAME_FORM, 1e10, 0.01, run_scale, false},
    {"scale", "nodes' scale 1e-8", SAME_FORM, 1e-8, 0.01, run_scale_node, false},
    {"scale", "nodes' scale 1e10", SAME_FORM, 1e10, 0.01, run_scale_node, false},
    {"translation", "1e5 m by the nodes", SAME_FORM, 1e5, 0.01, run_translation, false},
    {"translation", "1e11 m by the nodes", SAME_FORM, 1e11, 0.01, run_translation, false},
    {"shear", "by 1 and 0.3", SAME_FORM, 1, 0.01, run_shear, false},
    {"shear", "by 3 and 0.9", SAME_FORM, 3, 0.01, run_shear, false},
    {"mirror", "x times -1 by the nodes", SAME_FORM, -1, 0.01, run_mirror, false},
    {"mirror", "x times -3 by the nodes", SAME_FORM, -3, 0.01, run_mirror, false},
    {"radiance", "1e-30 W/(m2 sr)", SAME_FORM, 1e-30, 0.01, run_radiance, false},
    {"radiance", "1e-10 W/(m2 sr)", SAME_FORM, 1e-10, 0.01, run_radiance, false},
    {"radiance", "1e25 W/(m2 sr)", SAME_FORM, 1e25, 0.01, run_radiance, false},
    {"lamps", "1e-7 m wide, 1 m away", FLOOR_FORM, 1e-7, 0.01, run_lamp, false},
    {"lamps", "1e-3 m wide, 1 m away", FLOOR_FORM, 1e-3, 0.01, run_lamp, false},
    {"lamps", "1e3 m wide, 1 m away", FLOOR_FORM, 1e3, 0.01, run_lamp, false},
    {"lamps", "1e6 m wide, 1 m away", FLOOR_FORM, 1e6, 0.01, run_lamp, false},
    {"distances", "a lamp of 4 m, 1e-6 m away", FLOOR_FORM, 1e-6, 0.01, run_distance, false},
    {"distances", "a lamp of 4 m, 1e-3 m away", FLOOR_FORM, 1e-3, 0.01, run_distance, false},
    {"distances", "a lamp of 4 m, 1e6 m away", FLOOR_FORM, 1e6, 0.01, run_distance, false},
    {"distances", "a point light 1e6 m away", "all light within 1 %", 1e6, 0.01, run_point, false},
    {"near-light", "a point light 1 m above a floor", "all light within 1 %", 1, 0.01, run_point, false},
    {"near-light", "a point light 1 cm above a texel", "all light within 1 %, or a note", 1e-2, 0.01, run_point, false},
    {"near-light", "a point light 1 mm above a texel", "all light within 1 %, or a note", 1e-3, 0.01, run_point, false},
    {"thin-lamps", "5 cm x 100 m, 256 samples", "closed form, within 0.3 % rms", 0.05, 0.003, run_strip, false},
    {"thin-lamps", "2 cm x 100 m, 256 samples", "closed form, within 0.3 % rms", 0.02, 0.003, run_strip, false},
    {"thin-lamps", "0.1 mm x 100 m, 256 samples", "closed form, within 0.3 % rms", 1e-4, 0.003, run_strip, false},
    {"slivers", "a floor with triangles 1e4 times as long as wide", FLOOR_FORM, 1e4, 0.01, run_slivers, false},
    {"slivers", "a floor with triangles 1e8 times as long as wide", FLOOR_FORM, 1e8, 0.01, run_slivers, false},
    {"slivers", "a furnace of 2 x 2 m, 0.1 mm high", "E = pi L / (1 - albedo), within 1 %", 1e-4, 0.01,
     run_flat_furnace, false},
    {"not-a-number", "NaN as a coordinate", "refused, exit code 65", 0, 0, run_nan, false},
    {"maps", "1 x 1 texel", SAME_FORM, 1, 0.01, run_one_texel, false},
    {"half-floats", "radiance 1", "the map within 0.05 %", 1, 5e-4, run_half, false},
    {"half-floats", "radiance 1e5, beyond half floats", "the map within 0.05 %", 1e5, 5e-4, run_half, false},
    {"half-floats", "radiance 1e-7, below half floats", "the map within 0.05 %", 1e-7, 5e-4, run_half, false},
    {"cells", "0.1 m", "the same bits as with the default", 0.1, 0, run_cells, false},
    {"cells", "1000 m", "the same bits as with the default", 1000, 0, run_cells, false},
    {"samples", "1 of each kind", "a furnace's walls within 3 %", 1, 0.03, run_few_samples, false},
    {"samples", "10^6", "a furnace's walls within 0.02 %", 1e6, 2e-4, run_many_samples, false},
    {"furnace", "albedo 0.5", FURNACE_FORM, 0.5, 0.003, run_furnace, false},
    {"furnace", "albedo 0.99", FURNACE_FORM, 0.99, 0.003, run_furnace, false},
    {"furnace", "albedo 0.999", FURNACE_FORM, 0.999, 0.003, run_furnace, false},
    {"furnace", "albedo 1", "no end: said", 1, 0, run_furnace, false},
    {"coincident", "two opposite faces in a furnace", "E within 0.3 %, none lost", 0, 0.003, run_coincident, false},
    {"coincident", "the same in the other order", "E within 0.3 %, none lost", 1, 0.003, run_coincident, false},
    {"coincident", "with the same diagonal", "E within 0.3 %, none lost", 2, 0.003, run_coincident, false},
    {"coincident", "the same in the other order", "E within 0.3 %, none lost", 3, 0.003, run_coincident, false},
    {"coincident", "two floors that face the same way", "closed form at each texel, and a note", 0, 0.01, run_doubled,
     false},
    {"coincident", "the same with another diagonal", "closed form at each texel, and a note", 1, 0.01, run_doubled,
     false},
    {"largest-map", "16384 x 16384 texels", FLOOR_FORM, 16384, 0.01, run_largest_map, true}};

const size_t kiln_row_count = sizeof kiln_rows / sizeof *kiln_rows;
