#include "coordinator/view/view_surfaces.h"

#include <string.h>

#include "coordinator/view/view_gloss.h"
#include "worker/backend/particle.h"
#include "worker/base/memory.h"
#include "worker/material/scene_lobes.h"
#include "worker/scene/footprint.h"
#include "worker/scene/texture.h"

/* Rays along a side of a pixel, in pictures; rays traced together. */
enum { SIDE = 4, BAND_RAYS = 1 << 18 };

/* Largest number of mirrors and glass surfaces from which a ray goes on. */
enum { MOST_SURFACES = 16 };

enum {
    ALBEDO = KILN_SEEN_ALBEDO,
    EMISSION = KILN_SEEN_EMISSION,
    NORMAL = KILN_SEEN_NORMAL,
    POSITION = KILN_SEEN_POSITION,
    DEPTH = KILN_SEEN_DEPTH,
    PLANES
};

static const char *const names[] = {"albedo.R", "albedo.G", "albedo.B", "emission.R", "emission.G", "emission.B",
                                    "normal.X", "normal.Y", "normal.Z", "position.X", "position.Y", "position.Z",
                                    "Z",        "R",        "G",        "B"};
enum { CHANNELS = sizeof names / sizeof *names };

/* Last hit of a ray, and the share of its light that returns to the eye, by colour. */
struct reached {
    struct kiln_hit hit;
    float share[3];
};

/* Path of a ray through mirrors and glass. */
struct way {
    size_t ray;
    float share[3];
    bool goes_on;
};

/* A view whose surfaces are seen. */
struct seeing {
    const struct kiln_view_params *params;
    uint32_t side;
    struct kiln_view_rays *rays;
    float *const *planes;
    /* for following rays through mirrors and glass; NULL: rays end at their first hit */
    struct kiln_gloss_lobes *lobes;
    struct kiln_view_rays *onward; /* where ways lead */
    struct way *ways;
    struct reached *reached; /* by all rays */
};

static void put(float *const planes[], uint32_t plane, size_t pixel, float x, float y, float z)
{
    planes[plane][pixel] += x;
    planes[plane + 1][pixel] += y;
    planes[plane + 2][pixel] += z;
}

/* The shading normal on the side of the hit. */
static struct kiln_vec3 normal_at(const struct kiln_view_source *s, const struct kiln_hit *hit)
{
    const struct kiln_vec3 n = kiln_triangle_shading_normal(s->scene, s->geometry, hit->triangle, hit->u, hit->v);
    return hit->back ? vec3_scale(n, -1.0f) : n;
}

/* Adds the first hit of a ray, with weight `share` in the pixel. */
static void add_hit(const struct seeing *v, const struct kiln_hit *hit, float share, size_t pixel)
{
    const struct kiln_view_source *s = &v->params->source;
    const struct kiln_vec3 normal = normal_at(s, hit);
    put(v->planes, NORMAL, pixel, share * normal.x, share * normal.y, share * normal.z);
    if (v->planes[KILN_SEEN_COVERAGE] != NULL)
        v->planes[KILN_SEEN_COVERAGE][pixel] += share;
    if (v->planes[KILN_SEEN_GLOSS] != NULL && kiln_view_goes_on(s, hit))
        v->planes[KILN_SEEN_GLOSS][pixel] += share;
}

/* Adds the last hit of a ray, with weight `share` in the pixel. */
static void add_reached(const struct seeing *v, const struct reached *r, float share, size_t pixel)
{
    const struct kiln_view_source *s = &v->params->source;
    const struct kiln_geometry *g = s->geometry;
    const struct kiln_hit *hit = &r->hit;
    const uint64_t stored = g->stored_triangle[hit->triangle];
    const struct kiln_mesh *mesh = &s->scene->meshes[s->scene->objects[g->records[hit->triangle].object].mesh];
    const float part[3] = {share * r->share[0], share * r->share[1], share * r->share[2]};
    float color[4], emission[3], b1, b2;
    kiln_geometry_stored_barycentrics(s->scene, g, hit->triangle, hit->u, hit->v, &b1, &b2);
    kiln_surface_base_color(s->scene, mesh, stored, b1, b2, color);
    kiln_surface_emission(s->scene, mesh, stored, b1, b2, emission);
    put(v->planes, ALBEDO, pixel, part[0] * color[0], part[1] * color[1], part[2] * color[2]);
    put(v->planes, EMISSION, pixel, part[0] * emission[0], part[1] * emission[1], part[2] * emission[2]);
    if (v->planes[KILN_SEEN_REACHED_NORMAL] == NULL)
        return;
    const struct kiln_vec3 normal = normal_at(s, hit);
    put(v->planes, KILN_SEEN_REACHED_NORMAL, pixel, share * normal.x, share * normal.y, share * normal.z);
}

static struct kiln_dvec3 place_of(const struct kiln_view_params *p, const struct kiln_hit *hit)
{
    return dvec3_of(kiln_triangle_position(p->source.geometry, hit->triangle, hit->u, hit->v));
}

static void put_place(const struct seeing *v, uint32_t plane, struct kiln_dvec3 at, size_t pixel)
{
    const double *centre = v->params->source.scene->header->centre;
    put(v->planes, plane, pixel, (float)(at.x + centre[0]), (float)(at.y + centre[1]), (float)(at.z + centre[2]));
}

/* Where the middle ray ends. */
static void put_places(const struct seeing *v, const struct kiln_hit *hit, const struct reached *r, size_t pixel)
{
    const struct kiln_view_params *p = v->params;
    const struct kiln_dvec3 at = place_of(p, hit);
    put_place(v, POSITION, at, pixel);
    v->planes[DEPTH][pixel] = (float)dvec3_dot(dvec3_sub(at, p->camera.position), p->camera.forward);
    if (v->planes[KILN_SEEN_REACHED_POSITION] != NULL)
        put_place(v, KILN_SEEN_REACHED_POSITION, place_of(p, &r->hit), pixel);
}

/* `first`: ray of the pixel. */
static void shade(const struct seeing *v, size_t first, size_t pixel)
{
    const uint32_t side = v->side;
    const size_t rays = (size_t)side * side, middle = (size_t)((side - 1) / 2) * (side + 1);
    v->planes[DEPTH][pixel] = KILN_VIEW_FAR;
    for (size_t k = 0; k < rays; k++) {
        const struct kiln_hit *hit = &v->rays->hits[first + k];
        if (!kiln_view_is_seen(&v->params->source, hit))
            continue;
        const struct reached own = {*hit, {1.0f, 1.0f, 1.0f}}, *r = v->reached != NULL ? &v->reached[first + k] : &own;
        add_hit(v, hit, 1.0f / (float)rays, pixel);
        add_reached(v, r, 1.0f / (float)rays, pixel);
        if (k == middle)
            put_places(v, hit, r, pixel);
    }
}

/* ---- surfaces seen through mirrors and glass ---- */

/* Continues way k from the hit of its ray, if the surface reflects or transmits: new ray, and share of light. */
static void turn(const struct seeing *v, const struct kiln_hit *hit, float passed, size_t k)
{
    struct way *way = &v->ways[k];
    struct kiln_hit whole = *hit;
    struct kiln_vec3 origin, direction;
    float share[3];
    whole.distance += passed;
    way->goes_on = false;
    if (!kiln_view_is_seen(&v->params->source, hit) || !kiln_view_goes_on(&v->params->source, hit))
        return;
    const struct kiln_particle_place place =
        kiln_particle_place(&v->params->source.backend->params, v->lobes, &whole, v->onward->directions[k]);
    if (!kiln_particle_shows(&place, &origin, &direction, share))
        return;
    for (int c = 0; c < 3; c++)
        way->share[c] *= share[c];
    way->goes_on = way->share[0] > 0.0f || way->share[1] > 0.0f || way->share[2] > 0.0f;
    v->onward->origins[k] = origin;
    v->onward->directions[k] = direction;
}

/* Begins the way of ray i, as way i. */
static void begin(const struct seeing *v, size_t i)
{
    v->reached[i] = (struct reached){v->rays->hits[i], {1.0f, 1.0f, 1.0f}};
    v->ways[i] = (struct way){.ray = i, .share = {1.0f, 1.0f, 1.0f}};
    v->onward->directions[i] = v->rays->directions[i];
    turn(v, &v->rays->hits[i], v->rays->passed[i], i);
}

/* Takes in the hit of way k. */
static void meet(const struct seeing *v, size_t k)
{
    const struct kiln_hit *hit = &v->onward->hits[k];
    struct way *way = &v->ways[k];
    way->goes_on = false;
    if (!kiln_view_is_seen(&v->params->source, hit))
        return;
    struct reached r = {.hit = *hit};
    for (int c = 0; c < 3; c++)
        r.share[c] = way->share[c] *= hit->tint[c];
    turn(v, hit, v->onward->passed[k], k);
    if (!way->goes_on)
        v->reached[way->ray] = r;
}

/* Moves the ways that go on, among the first `count`, to the front. Returns their number. */
static size_t gather(const struct seeing *v, size_t count)
{
    size_t left = 0;
    for (size_t k = 0; k < count; k++) {
        if (!v->ways[k].goes_on)
            continue;
        v->ways[left] = v->ways[k];
        v->onward->origins[left] = v->onward->origins[k];
        v->onward->directions[left++] = v->onward->directions[k];
    }
    return left;
}

/* Follows the first `count` rays to their last hits. */
static int follow(const struct seeing *v, size_t count, struct kiln_error *error)
{
    int status = KILN_OK;
#pragma omp parallel for schedule(dynamic, 1024)
    for (size_t i = 0; i < count; i++)
        begin(v, i);
    size_t going = gather(v, count);
    for (int surface = 0; surface < MOST_SURFACES && going > 0 && status == KILN_OK; surface++) {
        status = kiln_view_trace(&v->params->source, v->onward, going, error);
        if (status != KILN_OK)
            break;
#pragma omp parallel for schedule(dynamic, 1024)
        for (size_t k = 0; k < going; k++)
            meet(v, k);
        going = gather(v, going);
    }
    return status;
}

static int look(const struct seeing *v, size_t first, size_t count, struct kiln_error *error)
{
    const size_t each = (size_t)v->side * v->side;
    int status = kiln_view_trace_pixels(v->params, v->side, v->rays, first, count, error);
    if (status == KILN_OK && v->reached != NULL)
        status = follow(v, count * each, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(dynamic, 256)
    for (size_t i = 0; i < count; i++)
        shade(v, i * each, first + i);
    return KILN_OK;
}

/* Makes room for rays that go on. */
static int prepare_onward(struct seeing *v, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_scene_lobes(&v->lobes, v->params->source.scene, error));
    KILN_TRY(kiln_view_rays_create(&v->onward, BAND_RAYS, error));
    KILN_TRY(kiln_allocate(&v->reached, BAND_RAYS, sizeof *v->reached, "what rays of a view reach", error));
    KILN_TRY(kiln_allocate(&v->ways, BAND_RAYS, sizeof *v->ways, "what rays of a view reach", error));
end:
    return status;
}

int kiln_view_see_surfaces(const struct kiln_view_params *params, uint32_t side, float *const planes[KILN_SEEN_PLANES],
                           struct kiln_error *error)
{
    const size_t pixels = (size_t)params->width * params->height, band = BAND_RAYS / ((size_t)side * side);
    struct seeing v = {.params = params, .side = side, .planes = planes};
    int status;
    KILN_TRY(kiln_view_rays_create(&v.rays, BAND_RAYS, error));
    if (planes[KILN_SEEN_REACHED_NORMAL] != NULL && params->source.scene->taken != NULL)
        KILN_TRY(prepare_onward(&v, error));
    for (size_t first = 0; first < pixels; first += band)
        KILN_TRY(kiln_stop_asked(params->source.stop)
                     ? kiln_give_up(error)
                     : look(&v, first, pixels - first < band ? pixels - first : band, error));
end:
    kiln_view_rays_destroy(&v.rays);
    kiln_view_rays_destroy(&v.onward);
    kiln_free(&v.lobes);
    kiln_free(&v.reached);
    kiln_free(&v.ways);
    return status;
}

int kiln_view_add_surfaces(const struct kiln_view_params *params, struct kiln_image **image, struct kiln_error *error)
{
    const size_t pixels = (size_t)params->width * params->height;
    float *planes[KILN_SEEN_PLANES] = {NULL}, *light[3], *copy[3];
    struct kiln_image *all = NULL;
    int status;
    KILN_TRY(kiln_image_create(&all, params->width, params->height, names, CHANNELS, error));
    for (uint32_t i = 0; i < PLANES; i++)
        planes[i] = kiln_image_find(all, names[i])->values;
    KILN_TRY(kiln_view_see_surfaces(params, SIDE, planes, error));
    if (kiln_image_rgb(*image, "", light) && kiln_image_rgb(all, "", copy)) {
        for (int c = 0; c < 3; c++)
            memcpy(copy[c], light[c], pixels * sizeof *copy[c]);
        kiln_image_destroy(image);
        *image = all;
        all = NULL;
    }
end:
    kiln_image_destroy(&all);
    return status;
}
