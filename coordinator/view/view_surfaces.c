#include "coordinator/view/view_surfaces.h"

#include <string.h>

#include "coordinator/view/view_light.h"
#include "worker/base/memory.h"
#include "worker/scene/footprint.h"
#include "worker/scene/texture.h"

/* Rays of a pixel along a side; the one nearest to its middle; rays that are traced together. */
enum { SIDE = 4, RAYS = SIDE * SIDE, MIDDLE = 5, BAND_RAYS = 1 << 18 };

enum { ALBEDO, EMISSION = 3, NORMAL = 6, POSITION = 9, DEPTH = 12, PLANES };

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

/* Adds what one ray of a pixel sees. */
static void add_hit(const struct kiln_view_source *s, const struct kiln_hit *hit, float *const planes[], size_t pixel)
{
    const struct kiln_geometry *g = s->geometry;
    const uint64_t stored = g->stored_triangle[hit->triangle];
    const struct kiln_mesh *mesh = &s->scene->meshes[s->scene->objects[g->records[hit->triangle].object].mesh];
    const float share = 1.0f / RAYS, side = hit->back ? -share : share;
    const struct kiln_vec3 normal = kiln_triangle_shading_normal(s->scene, g, hit->triangle, hit->u, hit->v);
    float color[4], emission[3], b1, b2;
    kiln_geometry_stored_barycentrics(s->scene, g, hit->triangle, hit->u, hit->v, &b1, &b2);
    kiln_surface_base_color(s->scene, mesh, stored, b1, b2, color);
    kiln_surface_emission(s->scene, mesh, stored, b1, b2, emission);
    put(planes, ALBEDO, pixel, share * color[0], share * color[1], share * color[2]);
    put(planes, EMISSION, pixel, share * emission[0], share * emission[1], share * emission[2]);
    put(planes, NORMAL, pixel, side * normal.x, side * normal.y, side * normal.z);
}

/* Where the middle ray ends. */
static void put_place(const struct kiln_view_params *p, const struct kiln_hit *hit, float *const planes[], size_t pixel)
{
    const double *centre = p->source.scene->header->centre;
    const struct kiln_dvec3 at = dvec3_of(kiln_triangle_position(p->source.geometry, hit->triangle, hit->u, hit->v));
    put(planes, POSITION, pixel, (float)(at.x + centre[0]), (float)(at.y + centre[1]), (float)(at.z + centre[2]));
    planes[DEPTH][pixel] = (float)dvec3_dot(dvec3_sub(at, p->camera.position), p->camera.forward);
}

static void shade(const struct kiln_view_params *p, const struct kiln_view_rays *rays, size_t from,
                  float *const planes[], size_t pixel)
{
    planes[DEPTH][pixel] = KILN_VIEW_FAR;
    for (size_t k = 0; k < RAYS; k++) {
        const struct kiln_hit *hit = &rays->hits[from + k];
        if (!kiln_view_is_seen(&p->source, hit))
            continue;
        add_hit(&p->source, hit, planes, pixel);
        if (k == MIDDLE)
            put_place(p, hit, planes, pixel);
    }
}

static int look(const struct kiln_view_params *p, struct kiln_view_rays *rays, size_t first, size_t count,
                float *const planes[], struct kiln_error *error)
{
#pragma omp parallel for schedule(dynamic, 4096)
    for (size_t i = 0; i < count * RAYS; i++) {
        const size_t pixel = first + i / RAYS;
        kiln_view_ray(p, (double)(pixel % p->width) + ((double)(i % SIDE) + 0.5) / SIDE,
                      (double)(pixel / p->width) + ((double)(i % RAYS / SIDE) + 0.5) / SIDE, &rays->origins[i],
                      &rays->directions[i]);
    }
    const int status = kiln_view_trace(&p->source, rays, count * RAYS, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(dynamic, 256)
    for (size_t i = 0; i < count; i++)
        shade(p, rays, i * RAYS, planes, first + i);
    return KILN_OK;
}

int kiln_view_add_surfaces(const struct kiln_view_params *params, struct kiln_image **image, struct kiln_error *error)
{
    const size_t pixels = (size_t)params->width * params->height, band = BAND_RAYS / RAYS;
    float *planes[PLANES], *light[3], *copy[3];
    struct kiln_view_rays *rays = NULL;
    struct kiln_image *all = NULL;
    int status = kiln_image_create(&all, params->width, params->height, names, CHANNELS, error);
    if (status == KILN_OK)
        status = kiln_view_rays_create(&rays, BAND_RAYS, error);
    for (uint32_t i = 0; status == KILN_OK && i < PLANES; i++)
        planes[i] = kiln_image_find(all, names[i])->values;
    for (size_t first = 0; status == KILN_OK && first < pixels; first += band)
        status = kiln_stop_asked(params->source.stop)
                     ? kiln_give_up(error)
                     : look(params, rays, first, pixels - first < band ? pixels - first : band, planes, error);
    if (status == KILN_OK && kiln_image_rgb(*image, "", light) && kiln_image_rgb(all, "", copy)) {
        for (int c = 0; c < 3; c++)
            memcpy(copy[c], light[c], pixels * sizeof *copy[c]);
        kiln_image_destroy(image);
        *image = all;
        all = NULL;
    }
    kiln_view_rays_destroy(&rays);
    kiln_image_destroy(&all);
    return status;
}
