#include "coordinator/view/view_surfaces.h"

#include <string.h>

#include "coordinator/view/view_gloss.h"
#include "worker/base/memory.h"
#include "worker/scene/footprint.h"
#include "worker/scene/texture.h"

/* Rays of a pixel along a side, of pictures; rays that are traced together. */
enum { SIDE = 4, BAND_RAYS = 1 << 18 };

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

static void put(float *const planes[], uint32_t plane, size_t pixel, float x, float y, float z)
{
    planes[plane][pixel] += x;
    planes[plane + 1][pixel] += y;
    planes[plane + 2][pixel] += z;
}

/* Adds what one ray of a pixel sees, which is `share` of it. */
static void add_hit(const struct kiln_view_source *s, const struct kiln_hit *hit, float share, float *const planes[],
                    size_t pixel)
{
    const struct kiln_geometry *g = s->geometry;
    const uint64_t stored = g->stored_triangle[hit->triangle];
    const struct kiln_mesh *mesh = &s->scene->meshes[s->scene->objects[g->records[hit->triangle].object].mesh];
    const float side = hit->back ? -share : share;
    const struct kiln_vec3 normal = kiln_triangle_shading_normal(s->scene, g, hit->triangle, hit->u, hit->v);
    float color[4], emission[3], b1, b2;
    kiln_geometry_stored_barycentrics(s->scene, g, hit->triangle, hit->u, hit->v, &b1, &b2);
    kiln_surface_base_color(s->scene, mesh, stored, b1, b2, color);
    kiln_surface_emission(s->scene, mesh, stored, b1, b2, emission);
    put(planes, ALBEDO, pixel, share * color[0], share * color[1], share * color[2]);
    put(planes, EMISSION, pixel, share * emission[0], share * emission[1], share * emission[2]);
    put(planes, NORMAL, pixel, side * normal.x, side * normal.y, side * normal.z);
    if (planes[KILN_SEEN_COVERAGE] != NULL)
        planes[KILN_SEEN_COVERAGE][pixel] += share;
    if (planes[KILN_SEEN_GLOSS] != NULL && kiln_view_goes_on(s, hit))
        planes[KILN_SEEN_GLOSS][pixel] += share;
}

/* Where the middle ray ends. */
static void put_place(const struct kiln_view_params *p, const struct kiln_hit *hit, float *const planes[], size_t pixel)
{
    const double *centre = p->source.scene->header->centre;
    const struct kiln_dvec3 at = dvec3_of(kiln_triangle_position(p->source.geometry, hit->triangle, hit->u, hit->v));
    put(planes, POSITION, pixel, (float)(at.x + centre[0]), (float)(at.y + centre[1]), (float)(at.z + centre[2]));
    planes[DEPTH][pixel] = (float)dvec3_dot(dvec3_sub(at, p->camera.position), p->camera.forward);
}

static void shade(const struct kiln_view_params *p, uint32_t side, const struct kiln_hit *hits, float *const planes[],
                  size_t pixel)
{
    const size_t rays = (size_t)side * side, middle = (size_t)((side - 1) / 2) * (side + 1);
    planes[DEPTH][pixel] = KILN_VIEW_FAR;
    for (size_t k = 0; k < rays; k++) {
        if (!kiln_view_is_seen(&p->source, &hits[k]))
            continue;
        add_hit(&p->source, &hits[k], 1.0f / (float)rays, planes, pixel);
        if (k == middle)
            put_place(p, &hits[k], planes, pixel);
    }
}

static int look(const struct kiln_view_params *p, uint32_t side, struct kiln_view_rays *rays, size_t first,
                size_t count, float *const planes[], struct kiln_error *error)
{
    const size_t each = (size_t)side * side;
    const int status = kiln_view_trace_pixels(p, side, rays, first, count, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(dynamic, 256)
    for (size_t i = 0; i < count; i++)
        shade(p, side, rays->hits + i * each, planes, first + i);
    return KILN_OK;
}

int kiln_view_see_surfaces(const struct kiln_view_params *params, uint32_t side, float *const planes[KILN_SEEN_PLANES],
                           struct kiln_error *error)
{
    const size_t pixels = (size_t)params->width * params->height, band = BAND_RAYS / ((size_t)side * side);
    struct kiln_view_rays *rays = NULL;
    int status = kiln_view_rays_create(&rays, BAND_RAYS, error);
    for (size_t first = 0; status == KILN_OK && first < pixels; first += band)
        status = kiln_stop_asked(params->source.stop)
                     ? kiln_give_up(error)
                     : look(params, side, rays, first, pixels - first < band ? pixels - first : band, planes, error);
    kiln_view_rays_destroy(&rays);
    return status;
}

int kiln_view_add_surfaces(const struct kiln_view_params *params, struct kiln_image **image, struct kiln_error *error)
{
    const size_t pixels = (size_t)params->width * params->height;
    float *planes[KILN_SEEN_PLANES] = {NULL}, *light[3], *copy[3];
    struct kiln_image *all = NULL;
    int status = kiln_image_create(&all, params->width, params->height, names, CHANNELS, error);
    for (uint32_t i = 0; status == KILN_OK && i < PLANES; i++)
        planes[i] = kiln_image_find(all, names[i])->values;
    if (status == KILN_OK)
        status = kiln_view_see_surfaces(params, SIDE, planes, error);
    if (status == KILN_OK && kiln_image_rgb(*image, "", light) && kiln_image_rgb(all, "", copy)) {
        for (int c = 0; c < 3; c++)
            memcpy(copy[c], light[c], pixels * sizeof *copy[c]);
        kiln_image_destroy(image);
        *image = all;
        all = NULL;
    }
    kiln_image_destroy(&all);
    return status;
}
