#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/files/html.h"
#include "coordinator/view/path_view.h"
#include "coordinator/view/places.h"
#include "worker/backend/backend.h"
#include "worker/base/memory.h"
#include "worker/scene/footprint.h"

enum { TRIES = 4096, LOOKS = 64, TURNS = 24, CANDIDATES = 48 };
enum { WIDE = 16, HIGH = 9, PATHS = 8, BOUNCES = 2 };      /* of the look at a candidate's light */
static const double MOST_BACKS = 0.0, MOST_ESCAPING = 0.5; /* shares of the rays from a place */
static const double LEAST_LIGHT = 0.1;                     /* of the light at the brightest quarter of the candidates */
static const double LEAST_NEAR = 0.01, LEAST_APART = 0.05; /* of the scene's diagonal */

struct search {
    const struct kiln_scene *scene;
    struct kiln_geometry *geometry;
    struct kiln_lights *lights;
    struct kiln_backend *backend;
    double *until; /* area of the triangles up to and with each */
    double diagonal;
    size_t count;
    struct kiln_vec3 eyes[CANDIDATES], ways[CANDIDATES];
    double light[CANDIDATES]; /* geometric mean of the radiance seen; 0: part of the picture is black */
};

static double fraction(double x) { return x - floor(x); }

static struct kiln_hit look(const struct search *s, struct kiln_vec3 origin, struct kiln_vec3 direction)
{
    struct kiln_hit hit = {.triangle = KILN_NONE};
    (void)kiln_backend_intersect(s->backend, &origin, &direction, 1, &hit, NULL);
    return hit;
}

/* Candidate k for an eye point: half-way along the normal from a point, uniform over all surfaces, to the opposite
 * surface. False: there is no opposite surface. */
static bool place_of(const struct search *s, uint32_t k, struct kiln_vec3 *eye)
{
    const size_t n = s->geometry->triangle_count;
    const double at = fraction((k + 0.5) * 0.8191725133961645) * s->until[n - 1],
                 u = fraction((k + 0.5) * 0.6710436067037893), v = fraction((k + 0.5) * 0.5497004779019703);
    size_t low = 0, high = n - 1;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (s->until[middle] > at)
            high = middle;
        else
            low = middle + 1;
    }
    const struct kiln_vec3 normal = kiln_triangle_normal(s->geometry, (uint32_t)low);
    const float root = (float)sqrt(u), b2 = root * (float)v;
    const struct kiln_vec3 point = kiln_offset_origin(kiln_triangle_position(s->geometry, (uint32_t)low, root - b2, b2),
                                                      normal, s->geometry, (uint32_t)low);
    const struct kiln_hit hit = look(s, point, normal);
    if (hit.triangle == KILN_NONE)
        return false;
    *eye = vec3_madd(point, normal, 0.5f * hit.distance);
    return true;
}

/* Whether the eye is in free space: in no solid, not outside, not close to a surface, and far from other places. */
static bool is_open(const struct search *s, struct kiln_vec3 eye)
{
    double backs = 0.0, escaping = 0.0, near = (double)INFINITY;
    for (size_t i = 0; i < s->count; i++)
        if ((double)vec3_length(vec3_sub(s->eyes[i], eye)) < LEAST_APART * s->diagonal)
            return false;
    for (int i = 0; i < LOOKS; i++) {
        const double y = 1.0 - 2.0 * (i + 0.5) / LOOKS, r = sqrt(1.0 - y * y),
                     phi = 2.0 * KILN_PI * fraction(i * 0.6180339887498949);
        const struct kiln_hit hit = look(s, eye, vec3_of(dvec3(r * cos(phi), y, r * sin(phi))));
        const bool met = hit.triangle != KILN_NONE;
        escaping += met ? 0.0 : 1.0 / LOOKS;
        if (met && hit.back && kiln_geometry_is_solid(s->geometry, hit.triangle))
            backs += 1.0 / LOOKS;
        near = met ? fmin(near, (double)hit.distance) : near;
    }
    return backs <= MOST_BACKS && escaping <= MOST_ESCAPING && near >= LEAST_NEAR * s->diagonal;
}

/* The horizontal direction in which the view reaches farthest but still ends at a surface. */
static struct kiln_vec3 farthest(const struct search *s, struct kiln_vec3 eye)
{
    struct kiln_vec3 best = vec3(0.0f, 0.0f, -1.0f);
    float most = 0.0f;
    for (int i = 0; i < TURNS; i++) {
        const double phi = 2.0 * KILN_PI * (i + 0.5) / TURNS;
        const struct kiln_vec3 way = vec3((float)cos(phi), 0.0f, (float)sin(phi));
        const struct kiln_hit hit = look(s, eye, way);
        if (hit.triangle != KILN_NONE && hit.distance > most) {
            most = hit.distance;
            best = way;
        }
    }
    return best;
}

/* Measures the light seen from candidate i. It counts as dark unless more than half of the pixels have light. */
static int look_at_light(struct search *s, size_t i, struct kiln_error *error)
{
    const struct kiln_vec3 way = s->ways[i], right = vec3(-way.z, 0.0f, way.x);
    const struct kiln_view_camera camera = {.position = dvec3_of(s->eyes[i]),
                                            .forward = dvec3_of(way),
                                            .right = dvec3_of(right),
                                            .up = dvec3(0.0, 1.0, 0.0),
                                            .extent_x = 1.0,
                                            .extent_y = (double)HIGH / WIDE};
    const struct kiln_path_view view = kiln_path_view_of(&camera, WIDE, HIGH, BOUNCES, PATHS);
    float rgb[3 * WIDE * HIGH];
    uint64_t rays = 0;
    double sum = 0.0, lit = 0.0;
    const int status =
        kiln_path_view_pixels(s->backend, &view, 0, (size_t)WIDE * HIGH, NULL, NULL, rgb, NULL, &rays, error);
    for (size_t p = 0; status == KILN_OK && p < (size_t)WIDE * HIGH; p++) {
        const double luminance = kiln_luminance_of_floats(rgb + 3 * p);
        sum += luminance > 0.0 ? log(luminance) : 0.0;
        lit += luminance > 0.0 ? 1.0 : 0.0;
    }
    s->light[i] = 2.0 * lit > (double)WIDE * HIGH ? exp(sum / lit) : 0.0;
    return status;
}

static int compare_numbers(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

/* Keeps the first `wanted` candidates that see enough light. */
static void keep_lit(struct search *s, size_t wanted)
{
    double sorted[CANDIDATES];
    size_t kept = 0;
    memcpy(sorted, s->light, s->count * sizeof *sorted);
    qsort(sorted, s->count, sizeof *sorted, compare_numbers);
    const double least = s->count > 0 ? LEAST_LIGHT * sorted[(s->count - 1) * 3 / 4] : 0.0;
    for (size_t i = 0; i < s->count && kept < wanted; i++) {
        if (!(s->light[i] > 0.0) || s->light[i] < least)
            continue;
        s->eyes[kept] = s->eyes[i];
        s->ways[kept++] = s->ways[i];
    }
    s->count = kept;
}

static int find(struct search *s, size_t wanted, struct kiln_error *error)
{
    struct kiln_vec3 eye;
    int status = KILN_OK;
    for (uint32_t k = 0; k < TRIES && s->count < CANDIDATES && status == KILN_OK; k++) {
        if (!place_of(s, k, &eye) || !is_open(s, eye))
            continue;
        s->eyes[s->count] = eye;
        s->ways[s->count] = farthest(s, eye);
        status = look_at_light(s, s->count++, error);
    }
    keep_lit(s, wanted);
    return status;
}

static int prepare(struct search *s, struct kiln_error *error)
{
    int status = kiln_geometry_create(&s->geometry, s->scene, error);
    if (status == KILN_OK && s->geometry->triangle_count == 0)
        status = kiln_fail(error, KILN_BAD_INPUT, "the scene has no triangles, so there is nothing to see");
    if (status == KILN_OK)
        status = kiln_allocate(&s->until, s->geometry->triangle_count, sizeof *s->until, "areas", error);
    if (status != KILN_OK)
        return status;
    double area = 0.0;
    for (size_t i = 0; i < s->geometry->triangle_count; i++)
        s->until[i] = area += kiln_geometry_triangle_area(s->geometry, i);
    s->diagonal = (double)vec3_length(vec3_sub(s->geometry->bounds_max, s->geometry->bounds_min));
    status = kiln_lights_create(&s->lights, s->scene, s->geometry, error);
    const struct kiln_backend_params params = {
        .scene = s->scene, .geometry = s->geometry, .lights = s->lights, .threads = 1};
    return status != KILN_OK ? status : kiln_backend_create(&s->backend, "embree", &params, error);
}

static int write_keys(const struct search *s, const char *path, struct kiln_error *error)
{
    struct kiln_html file = {.error = error};
    const double *centre = s->scene->header->centre;
    kiln_html_add(&file, "from.x,from.y,from.z,to.x,to.y,to.z,field-of-view\n");
    for (size_t i = 0; i < s->count; i++) {
        const struct kiln_vec3 a = s->eyes[i], b = vec3_add(a, s->ways[i]);
        kiln_html_add(&file, "%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,60\n", (double)a.x + centre[0], (double)a.y + centre[1],
                      (double)a.z + centre[2], (double)b.x + centre[0], (double)b.y + centre[1],
                      (double)b.z + centre[2]);
    }
    return kiln_html_publish(&file, path);
}

int kiln_places_write(const struct kiln_scene *scene, size_t wanted, const char *path, struct kiln_error *error)
{
    struct search s = {.scene = scene};
    int status;
    KILN_TRY(prepare(&s, error));
    KILN_TRY(find(&s, wanted, error));
    if (s.count < wanted)
        KILN_TRY(
            kiln_fail(error, KILN_BAD_INPUT,
                      "the scene has %zu of the %zu lit places inside to look from: scenes that are rooms, streets "
                      "or courts have them",
                      s.count, wanted));
    KILN_TRY(write_keys(&s, path, error));
end:
    kiln_backend_destroy(&s.backend);
    kiln_lights_destroy(&s.lights);
    kiln_free(&s.until);
    kiln_geometry_destroy(&s.geometry);
    return status;
}
