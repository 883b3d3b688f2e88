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

/* Whether both triangles have the same corners, up to rounding. */
static bool same_corners(const struct kiln_dvec3 a[3], const struct kiln_dvec3 b[3])
{
    for (int c = 0; c < 3; c++)
        if (!(dvec3_length(dvec3_sub(a[c], b[c])) <= 1e-6 * (dvec3_length(a[c]) + sqrt(area_of(a)))))
            return false;
    return true;
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
    for (int c = 0; status == KILN_OK && c < 5; c++) {
        const float *values = plane(from->lightmap, names[c]);
        if (c < 3)
            r->planes[c] = values;
        r->to[c] = kiln_image_find(*made, names[c])->values;
        if (c < 3 && values == NULL)
            status = kiln_fail(error, KILN_BAD_INPUT, "a lightmap has no channels R, G and B");
    }
    r->validity = plane(from->lightmap, "validity.Y");
    r->coverage = plane(from->lightmap, "coverage.Y");
    return status;
}

/* Reads the lightmap at a point of the object's k-th triangle, with barycentric weights b1 and b2 of corners 1 and 2.
 */
static void read_place(const struct reader *r, uint64_t k, double b1, double b2, size_t to)
{
    const struct kiln_image *image = r->from->lightmap;
    const struct kiln_scene *scene = r->from->scene;
    uint64_t corner[3];
    stored_corners(scene, r->from->object, k, corner);
    double uv[2] = {0.0, 0.0};
    for (int c = 0; c < 3; c++) {
        const double weight = c == 0 ? 1.0 - b1 - b2 : c == 1 ? b1 : b2;
        uv[0] += weight * (double)scene->texcoord_lightmap[corner[c]].x;
        uv[1] += weight * (double)scene->texcoord_lightmap[corner[c]].y;
    }
    const double x = uv[0] * image->width, y = uv[1] * image->height, last_x = image->width - 1.0,
                 last_y = image->height - 1.0;
    const double fx = fmin(fmax(x - 0.5, 0.0), last_x), fy = fmin(fmax(y - 0.5, 0.0), last_y), wx = fx - floor(fx),
                 wy = fy - floor(fy);
    const size_t x0 = (size_t)fx, y0 = (size_t)fy, x1 = wx > 0.0 ? x0 + 1 : x0, y1 = wy > 0.0 ? y0 + 1 : y0;
    const size_t texels[4] = {y0 * image->width + x0, y0 * image->width + x1, y1 * image->width + x0,
                              y1 * image->width + x1};
    const double weights[4] = {(1.0 - wx) * (1.0 - wy), wx * (1.0 - wy), (1.0 - wx) * wy, wx * wy};
    const size_t own = (size_t)fmin(fmax(y, 0.0), last_y) * image->width + (size_t)fmin(fmax(x, 0.0), last_x);
    float least = 1.0f;
    for (int c = 0; c < 3; c++) {
        double sum = 0.0;
        for (int t = 0; t < 4; t++)
            sum += weights[t] * (double)r->planes[c][texels[t]];
        r->to[c][to] = (float)sum;
    }
    for (int t = 0; r->coverage != NULL && t < 4; t++)
        least = fminf(least, r->coverage[texels[t]]);
    r->to[3][to] = r->validity == NULL ? 1.0f : r->validity[own];
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
            return kiln_fail(error, KILN_BAD_INPUT, "triangle %llu is not in the same place in both",
                             (unsigned long long)k);
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
    if (triangles_of(a->scene, a->object) != triangles_of(b->scene, b->object))
        return kiln_fail(error, KILN_BAD_INPUT, "it has %llu triangles in one and %llu in the other",
                         (unsigned long long)triangles_of(a->scene, a->object),
                         (unsigned long long)triangles_of(b->scene, b->object));
    int status = kiln_allocate(&samples->positions, count, sizeof *samples->positions, "places to compare", error);
    if (status == KILN_OK)
        status = open_reader(&readers[0], a, count, &samples->a, error);
    if (status == KILN_OK)
        status = open_reader(&readers[1], b, count, &samples->b, error);
    if (status == KILN_OK)
        status = take_samples(samples, readers, error);
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
