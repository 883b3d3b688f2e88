#include "coordinator/view/compare_surface.h"

#include <math.h>
#include <string.h>

#include "worker/base/memory.h"

/* ---- triangles ---- */

static struct kiln_dvec3 to_world(const double m[12], struct kiln_vec3 p)
{
    const double x = (double)p.x, y = (double)p.y, z = (double)p.z;
    return dvec3(m[0] * x + m[1] * y + m[2] * z + m[3], m[4] * x + m[5] * y + m[6] * z + m[7],
                 m[8] * x + m[9] * y + m[10] * z + m[11]);
}

/* Indices of the corners of the mesh's k-th triangle in the vertex arrays of the scene. */
static void stored_corners(const struct kiln_scene *scene, uint32_t object, uint64_t k, uint64_t corner[3])
{
    const struct kiln_mesh *mesh = &scene->meshes[scene->objects[object].mesh];
    const uint32_t *indices = scene->triangles + 3 * (size_t)(mesh->triangle_first + k);
    for (int c = 0; c < 3; c++)
        corner[c] = mesh->vertex_first + indices[c];
}

static void world_corners(const struct kiln_scene *scene, uint32_t object, uint64_t k, struct kiln_dvec3 place[3])
{
    uint64_t corner[3];
    stored_corners(scene, object, k, corner);
    for (int c = 0; c < 3; c++)
        place[c] = to_world(scene->objects[object].transform, scene->positions[corner[c]]);
}

static double area_of(const struct kiln_dvec3 p[3])
{
    return 0.5 * dvec3_length(dvec3_cross(dvec3_sub(p[1], p[0]), dvec3_sub(p[2], p[0])));
}

static uint64_t triangles_of(const struct kiln_scene *scene, uint32_t object)
{
    return scene->meshes[scene->objects[object].mesh].triangle_count;
}

double kiln_object_area(const struct kiln_scene *scene, uint32_t object)
{
    double sum = 0.0;
    for (uint64_t k = 0; k < triangles_of(scene, object); k++) {
        struct kiln_dvec3 place[3];
        world_corners(scene, object, k, place);
        sum += area_of(place);
    }
    return sum;
}

/* Whether both triangles have the same corners, up to rounding errors. */
static bool same_corners(const struct kiln_dvec3 a[3], const struct kiln_dvec3 b[3])
{
    for (int c = 0; c < 3; c++)
        if (!(dvec3_length(dvec3_sub(a[c], b[c])) <= 1e-6 * (dvec3_length(a[c]) + sqrt(area_of(a)))))
            return false;
    return true;
}

static int moved(uint64_t k, struct kiln_error *error)
{
    return kiln_fail(error, KILN_BAD_INPUT, "triangle %llu is not in the same place in both", (unsigned long long)k);
}

static int check_counts(const struct kiln_compared *a, const struct kiln_compared *b, struct kiln_error *error)
{
    const uint64_t in_a = triangles_of(a->scene, a->object), in_b = triangles_of(b->scene, b->object);
    return in_a == in_b ? KILN_OK
                        : kiln_fail(error, KILN_BAD_INPUT, "it has %llu triangles in one and %llu in the other",
                                    (unsigned long long)in_a, (unsigned long long)in_b);
}

/* ---- lightmaps ---- */

struct reader {
    const struct kiln_compared *from;
    const float *planes[3], *validity, *coverage; /* validity and coverage may be NULL */
    float *to[5];
};

static const float *plane(const struct kiln_image *image, const char *name)
{
    const struct kiln_image_channel *channel = kiln_image_find(image, name);
    return channel == NULL ? NULL : channel->values;
}

static int open_reader(struct reader *r, const struct kiln_compared *from, size_t count, struct kiln_image **made,
                       struct kiln_error *error)
{
    static const char *const names[] = {"R", "G", "B", "validity.Y", "coverage.Y"};
    int status = kiln_image_create(made, (uint32_t)count, 1, names, 5, error);
    r->from = from;
    for (int c = 0; status == KILN_OK && c < 5; c++)
        r->to[c] = kiln_image_find(*made, names[c])->values;
    if (status != KILN_OK || from->leaves != NULL)
        return status;
    for (int c = 0; c < 3; c++) {
        r->planes[c] = plane(from->lightmap, names[c]);
        if (r->planes[c] == NULL)
            return kiln_fail(error, KILN_BAD_INPUT, "a lightmap has no channels R, G and B");
    }
    r->validity = plane(from->lightmap, "validity.Y");
    r->coverage = plane(from->lightmap, "coverage.Y");
    return KILN_OK;
}

/* A place in a lightmap: the texels around it with their bilinear weights, and the one that contains it. */
struct footprint {
    size_t texels[4], own;
    double weights[4];
};

/* Lightmap coordinates of the corners, times `width` and `height`. */
static void layout_corners(const struct kiln_compared *from, uint64_t k, double width, double height,
                           double corners[3][2])
{
    uint64_t corner[3];
    stored_corners(from->scene, from->object, k, corner);
    for (int c = 0; c < 3; c++) {
        corners[c][0] = (double)from->scene->texcoord_lightmap[corner[c]].x * width;
        corners[c][1] = (double)from->scene->texcoord_lightmap[corner[c]].y * height;
    }
}

/* The place of the object's k-th triangle with barycentric weights b1 and b2 of corners 1 and 2. */
static struct footprint find_place(const struct kiln_compared *from, uint64_t k, double b1, double b2)
{
    const struct kiln_image *image = from->lightmap;
    double corners[3][2];
    layout_corners(from, k, 1.0, 1.0, corners);
    const double b0 = 1.0 - b1 - b2, x = (b0 * corners[0][0] + b1 * corners[1][0] + b2 * corners[2][0]) * image->width,
                 y = (b0 * corners[0][1] + b1 * corners[1][1] + b2 * corners[2][1]) * image->height,
                 last_x = image->width - 1.0, last_y = image->height - 1.0;
    const double fx = fmin(fmax(x - 0.5, 0.0), last_x), fy = fmin(fmax(y - 0.5, 0.0), last_y), wx = fx - floor(fx),
                 wy = fy - floor(fy);
    const size_t x0 = (size_t)fx, y0 = (size_t)fy, x1 = wx > 0.0 ? x0 + 1 : x0, y1 = wy > 0.0 ? y0 + 1 : y0;
    return (struct footprint){
        .texels = {y0 * image->width + x0, y0 * image->width + x1, y1 * image->width + x0, y1 * image->width + x1},
        .weights = {(1.0 - wx) * (1.0 - wy), wx * (1.0 - wy), (1.0 - wx) * wy, wx * wy},
        .own = (size_t)fmin(fmax(y, 0.0), last_y) * image->width + (size_t)fmin(fmax(x, 0.0), last_x)};
}

static double read_at(const float *values, const struct footprint *place)
{
    double sum = 0.0;
    for (int t = 0; t < 4; t++)
        sum += place->weights[t] * (double)values[place->texels[t]];
    return sum;
}

/* As the lookup in a lightmap, for leaves, which have no margins. */
static void read_leaf(const struct reader *r, uint64_t k, double b1, double b2, size_t to)
{
    float rgb[3];
    r->to[3][to] = kiln_compared_leaves_at(r->from->leaves, r->from->object, k, b1, b2, rgb) ? 1.0f : 0.0f;
    r->to[4][to] = 1.0f;
    for (int c = 0; c < 3; c++)
        r->to[c][to] = rgb[c];
}

static void read_place(const struct reader *r, uint64_t k, double b1, double b2, size_t to)
{
    if (r->from->leaves != NULL) {
        read_leaf(r, k, b1, b2, to);
        return;
    }
    const struct footprint place = find_place(r->from, k, b1, b2);
    float least = 1.0f;
    for (int c = 0; c < 3; c++)
        r->to[c][to] = (float)read_at(r->planes[c], &place);
    for (int t = 0; r->coverage != NULL && t < 4; t++)
        least = fminf(least, r->coverage[place.texels[t]]);
    r->to[3][to] = r->validity == NULL ? 1.0f : r->validity[place.own];
    r->to[4][to] = least;
}

/* ---- samples ---- */

static double fraction(double x) { return x - floor(x); }

static void take_sample(struct kiln_samples *s, const struct reader readers[2], const struct kiln_dvec3 place[3],
                        uint64_t k, size_t i)
{
    double b1 = fraction((double)i * 0.7548776662466927 + 0.5), b2 = fraction((double)i * 0.5698402909980532 + 0.5);
    if (b1 + b2 > 1.0) {
        b1 = 1.0 - b1;
        b2 = 1.0 - b2;
    }
    const struct kiln_dvec3 at = dvec3_add(dvec3_scale(place[0], 1.0 - b1 - b2),
                                           dvec3_add(dvec3_scale(place[1], b1), dvec3_scale(place[2], b2)));
    s->positions[i][0] = at.x;
    s->positions[i][1] = at.y;
    s->positions[i][2] = at.z;
    read_place(&readers[0], k, b1, b2, i);
    read_place(&readers[1], k, b1, b2, i);
}

static int take_samples(struct kiln_samples *s, const struct reader readers[2], struct kiln_error *error)
{
    const struct kiln_compared *a = readers[0].from, *b = readers[1].from;
    double sum = 0.0;
    size_t taken = 0;
    for (uint64_t k = 0; k < triangles_of(a->scene, a->object); k++) {
        struct kiln_dvec3 place[3], other[3];
        world_corners(a->scene, a->object, k, place);
        world_corners(b->scene, b->object, k, other);
        if (!same_corners(place, other))
            return moved(k, error);
        sum += area_of(place);
        while (taken < s->count && (double)s->count * sum > ((double)taken + 0.5) * s->area)
            take_sample(s, readers, place, k, taken++);
    }
    return taken == s->count ? KILN_OK : kiln_fail(error, KILN_BUG, "%zu of %zu places were found", taken, s->count);
}

int kiln_samples_take(struct kiln_samples *samples, const struct kiln_compared *a, const struct kiln_compared *b,
                      size_t count, struct kiln_error *error)
{
    struct reader readers[2] = {{0}, {0}};
    *samples = (struct kiln_samples){.count = count, .area = kiln_object_area(a->scene, a->object)};
    int status;
    KILN_TRY(check_counts(a, b, error));
    KILN_TRY(kiln_allocate(&samples->positions, count, sizeof *samples->positions, "places to compare", error));
    KILN_TRY(open_reader(&readers[0], a, count, &samples->a, error));
    KILN_TRY(open_reader(&readers[1], b, count, &samples->b, error));
    KILN_TRY(take_samples(samples, readers, error));
end:
    if (status != KILN_OK)
        kiln_samples_destroy(samples);
    return status;
}

void kiln_samples_destroy(struct kiln_samples *samples)
{
    kiln_image_destroy(&samples->a);
    kiln_image_destroy(&samples->b);
    kiln_free(&samples->positions);
}

/* ---- texels ---- */

/* The planes of both lightmaps. */
struct layers {
    float *a[KILN_LAYERS][3], *b[KILN_LAYERS][3];
    const float *valid_a, *valid_b; /* NULL: all are */
};

static int find_layers(struct layers *l, const struct kiln_image *a, const struct kiln_image *b,
                       struct kiln_error *error)
{
    static const char *const prefixes[KILN_LAYERS] = {"", "direct.", "indirect."};
    l->valid_a = plane(a, "validity.Y");
    l->valid_b = plane(b, "validity.Y");
    for (int i = 0; i < KILN_LAYERS; i++)
        if (!kiln_image_rgb(a, prefixes[i], l->a[i]) || !kiln_image_rgb(b, prefixes[i], l->b[i]))
            return kiln_fail(error, KILN_BAD_INPUT, "a lightmap has no channels %sR, G and B", prefixes[i]);
    return KILN_OK;
}

static void add_texel(struct kiln_texel_sums *sums, const struct layers *l, double area, const struct footprint *in_a,
                      size_t in_b)
{
    if ((l->valid_a != NULL && l->valid_a[in_a->own] < 1.0f) || (l->valid_b != NULL && l->valid_b[in_b] < 1.0f))
        return;
    double squares[KILN_LAYERS] = {0.0}, reference = 0.0;
    for (int i = 0; i < KILN_LAYERS; i++)
        for (int c = 0; c < 3; c++) {
            const double b = (double)l->b[i][c][in_b], off = read_at(l->a[i][c], in_a) - b;
            squares[i] += off * off;
            reference += i == 0 ? b : 0.0;
        }
    if (!isfinite(reference) || !isfinite(squares[0] + squares[1] + squares[2])) {
        sums->not_finite++;
        return;
    }
    sums->texels++;
    sums->area += area;
    sums->reference += area * reference;
    for (int i = 0; i < KILN_LAYERS; i++)
        sums->squares[i] += area * squares[i];
}

static double edge(const double p[2], const double q[2], double x, double y)
{
    return (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]);
}

/* Whether a point is on the inner side of the edge from p to q. `inside`: edge() times the triangle's winding. Points
 * on an edge belong to only one of the two triangles that share it. */
static bool is_inside(const double p[2], const double q[2], double winding, double inside)
{
    const double across = winding * (q[1] - p[1]), along = winding * (q[0] - p[0]);
    return inside > 0.0 || (inside == 0.0 && (across > 0.0 || (across == 0.0 && along < 0.0)));
}

/* Adds the texels of b's lightmap whose centres lie in the k-th triangle, which has `area` m2. */
static void add_triangle(struct kiln_texel_sums *sums, const struct layers *l, const struct kiln_compared *a,
                         const struct kiln_compared *b, uint64_t k, double area)
{
    double p[3][2];
    const double width = b->lightmap->width, height = b->lightmap->height;
    layout_corners(b, k, width, height, p);
    const double twice = edge(p[0], p[1], p[2][0], p[2][1]), winding = twice < 0.0 ? -1.0 : 1.0,
                 each = 2.0 * area / fabs(twice);
    const double left = fmax(0.0, floor(fmin(p[0][0], fmin(p[1][0], p[2][0])))),
                 right = fmin(width, ceil(fmax(p[0][0], fmax(p[1][0], p[2][0])))),
                 top = fmax(0.0, floor(fmin(p[0][1], fmin(p[1][1], p[2][1])))),
                 bottom = fmin(height, ceil(fmax(p[0][1], fmax(p[1][1], p[2][1]))));
    if (!(fabs(twice) > 0.0) || !isfinite(each))
        return;
    for (double y = top + 0.5; y < bottom; y += 1.0)
        for (double x = left + 0.5; x < right; x += 1.0) {
            const double w0 = winding * edge(p[1], p[2], x, y), w1 = winding * edge(p[2], p[0], x, y),
                         w2 = winding * edge(p[0], p[1], x, y);
            if (!is_inside(p[1], p[2], winding, w0) || !is_inside(p[2], p[0], winding, w1) ||
                !is_inside(p[0], p[1], winding, w2))
                continue;
            const struct footprint in_a = find_place(a, k, w1 / fabs(twice), w2 / fabs(twice));
            add_texel(sums, l, each, &in_a, (size_t)y * b->lightmap->width + (size_t)x);
        }
}

int kiln_texels_add(struct kiln_texel_sums *sums, const struct kiln_compared *a, const struct kiln_compared *b,
                    struct kiln_error *error)
{
    struct layers layers;
    int status;
    KILN_TRY(check_counts(a, b, error));
    KILN_TRY(find_layers(&layers, a->lightmap, b->lightmap, error));
    for (uint64_t k = 0; k < triangles_of(b->scene, b->object); k++) {
        struct kiln_dvec3 in_a[3], in_b[3];
        world_corners(a->scene, a->object, k, in_a);
        world_corners(b->scene, b->object, k, in_b);
        if (!same_corners(in_a, in_b))
            return moved(k, error);
        add_triangle(sums, &layers, a, b, k, area_of(in_b));
    }
end:
    return status;
}
