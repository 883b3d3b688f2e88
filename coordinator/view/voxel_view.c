#include "coordinator/view/voxel_view.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/view/view_light.h"

enum { BAND_RAYS = 1 << 18 };

static const float tones[2][3] = {{0.80f, 0.50f, 0.16f}, {0.14f, 0.36f, 0.60f}};
static const float shades[3] = {0.55f, 1.0f, 0.3f}; /* of sides across x, y and z */
static const float empty[2][3] = {{0.20f, 0.20f, 0.20f}, {0.07f, 0.07f, 0.07f}};

static int turn_of(const struct kiln_voxel *voxel) { return (voxel->cell[0] + voxel->cell[1] + voxel->cell[2]) & 1; }

void kiln_voxel_view_place(const struct kiln_view_source *source, float rgb[3])
{
    const double *centre = source->scene->header->centre;
    struct kiln_voxel voxel;
    if (!isfinite(rgb[0]) || !isfinite(rgb[1]) || !isfinite(rgb[2]))
        return;
    const struct kiln_vec3 at = vec3((float)((double)rgb[0] - centre[0]), (float)((double)rgb[1] - centre[1]),
                                     (float)((double)rgb[2] - centre[2]));
    const bool filled = kiln_voxels_at(source->voxels, at, &voxel);
    memcpy(rgb, filled ? tones[turn_of(&voxel)] : empty[turn_of(&voxel)], 3 * sizeof *rgb);
}

/* Draws a band of pixels with `each` rays a pixel. */
static int look(const struct kiln_voxels *voxels, const struct kiln_view_params *p, struct kiln_view_rays *rays,
                size_t first, size_t count, float *const planes[3], struct kiln_error *error)
{
    const size_t each = (size_t)p->side * p->side;
    const int status = kiln_view_trace_pixels(p, p->side, rays, first, count, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(dynamic, 256)
    for (size_t i = 0; i < count; i++)
        for (size_t k = i * each; k < (i + 1) * each; k++) {
            struct kiln_voxel met;
            if (!kiln_voxels_meet(voxels, rays->origins[k], rays->directions[k], &met))
                continue;
            for (int c = 0; c < 3; c++)
                planes[c][first + i] += shades[met.axis] * tones[turn_of(&met)][c] / (float)each;
        }
    return KILN_OK;
}

int kiln_voxel_view_render(void *context, const struct kiln_view_params *p, struct kiln_image **image,
                           struct kiln_error *error)
{
    static const char *const names[] = {"R", "G", "B"};
    const size_t pixels = (size_t)p->width * p->height, band = BAND_RAYS / ((size_t)p->side * p->side);
    struct kiln_view_rays *rays = NULL;
    float *planes[3];
    int status;
    KILN_TRY(kiln_image_create(image, p->width, p->height, names, 3, error));
    KILN_TRY(kiln_view_rays_create(&rays, BAND_RAYS, error));
    (void)kiln_image_rgb(*image, "", planes);
    for (size_t first = 0; first < pixels; first += band)
        KILN_TRY(kiln_stop_asked(p->source.stop)
                     ? kiln_give_up(error)
                     : look(context, p, rays, first, pixels - first < band ? pixels - first : band, planes, error));
end:
    kiln_view_rays_destroy(&rays);
    return status;
}

void kiln_voxel_view_key(const struct kiln_voxels *voxels, bool boxes, struct kiln_color_key *key)
{
    static const char *const sides[] = {"x sides", "y sides", "z sides"}, *const fills[] = {"filled", "not filled"};
    const struct kiln_voxel_grid grid = kiln_voxels_grid(voxels);
    *key = (struct kiln_color_key){.pairs = boxes ? 3 : 2};
    for (int i = 0; i < key->pairs; i++) {
        (void)snprintf(key->of[i].text, sizeof key->of[i].text, "%s", boxes ? sides[i] : fills[i]);
        for (int turn = 0; turn < 2; turn++)
            for (int c = 0; c < 3; c++)
                key->of[i].rgb[turn][c] = boxes ? shades[i] * tones[turn][c] : i == 0 ? tones[turn][c] : empty[turn][c];
    }
    (void)snprintf(key->note, sizeof key->note,
                   "two colours by turns, for cells of %.4g m: %d x %d x %d, of which %llu (%.3g %%) are filled",
                   grid.side, grid.n[0], grid.n[1], grid.n[2], (unsigned long long)grid.filled,
                   100.0 * (double)grid.filled / ((double)grid.n[0] * grid.n[1] * grid.n[2]));
}
