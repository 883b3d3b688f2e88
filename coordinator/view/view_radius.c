#include "coordinator/view/view_radius.h"

#include <math.h>
#include <stdlib.h>

#include "worker/backend/extended.h"
#include "worker/base/memory.h"

enum { RAYS_ASIDE = 64 };                   /* in each direction at most */
static const double PIXELS_LEAST = 32 * 32; /* that a picture counts as having */
static const double NEAREST = 1e-4; /* least depth, relative to the scene's extent: limits the number of merge cells */
static const double STEPS = 8.0;    /* depths are rounded to this many steps per octave */

struct looks {
    struct kiln_vec3 origins[RAYS_ASIDE * RAYS_ASIDE], directions[RAYS_ASIDE * RAYS_ASIDE];
    struct kiln_hit hits[RAYS_ASIDE * RAYS_ASIDE];
    double depths[RAYS_ASIDE * RAYS_ASIDE]; /* depths of the hits along the camera's axis, m */
};

static int compare_depths(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Rays over the whole picture; their number. */
static size_t make_rays(const struct kiln_view_params *params, struct looks *looks)
{
    const uint32_t columns = params->width < RAYS_ASIDE ? params->width : RAYS_ASIDE,
                   rows = params->height < RAYS_ASIDE ? params->height : RAYS_ASIDE;
    for (uint32_t i = 0; i < columns * rows; i++) {
        const double x = (i % columns + 0.5) / columns, y = (i / columns + 0.5) / rows;
        kiln_view_ray(params, x * params->width, y * params->height, &looks->origins[i], &looks->directions[i]);
    }
    return (size_t)columns * rows;
}

/* Median depth of `count` rays' hits, m; the scene's extent if there are none. */
static double median_depth(struct looks *looks, size_t count, struct kiln_dvec3 forward, double extent)
{
    size_t met = 0;
    for (size_t i = 0; i < count; i++)
        if (looks->hits[i].triangle != KILN_NONE)
            looks->depths[met++] = (double)looks->hits[i].distance * dvec3_dot(dvec3_of(looks->directions[i]), forward);
    if (met == 0)
        return extent;
    qsort(looks->depths, met, sizeof *looks->depths, compare_depths);
    return exp2(round(STEPS * log2(fmax(looks->depths[met / 2], NEAREST * extent))) / STEPS);
}

int kiln_view_pixel_width(struct kiln_backend *backend, const struct kiln_geometry *geometry,
                          const struct kiln_view_params *params, double *width, struct kiln_error *error)
{
    const struct kiln_view_camera *c = &params->camera;
    const double pixels = fmax((double)params->width * params->height, PIXELS_LEAST),
                 pixel = 2.0 * sqrt(c->extent_x * c->extent_y / pixels); /* its side, at distance 1 */
    struct looks *looks = NULL;
    *width = pixel;
    if (c->orthographic)
        return KILN_OK;
    int status = kiln_allocate(&looks, 1, sizeof *looks, "rays of a view", error);
    if (status == KILN_OK) {
        const size_t count = make_rays(params, looks);
        status = kiln_backend_intersect_hinted(backend, looks->origins, looks->directions, count,
                                               &(struct kiln_ray_hints){.alike = true}, looks->hits, error);
        if (status == KILN_OK)
            *width = pixel * median_depth(looks, count, c->forward, (double)geometry->extent);
    }
    kiln_free(&looks);
    return status;
}
