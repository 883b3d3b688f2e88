#include "worker/light/environment.h"

#include <math.h>
#include <string.h>

#include "worker/base/memory.h"
#include "worker/sampling/sequence.h"

/* Mean of sin(theta) over row y of h. */
static double row_sine(uint32_t y, uint32_t h)
{
    const double top = KILN_PI * y / h, bottom = KILN_PI * (y + 1.0) / h;
    return (cos(top) - cos(bottom)) * h / KILN_PI;
}

static const float *texel_of(const struct kiln_scene *scene, uint32_t x, uint32_t y)
{
    return scene->environment_texels + 3 * ((size_t)y * scene->environment->width + x);
}

int kiln_environment_build(struct kiln_lights *lights, struct kiln_error *error)
{
    const struct kiln_environment *e = lights->scene->environment;
    if (e->kind == KILN_ENVIRONMENT_NONE)
        return KILN_OK;
    if (e->kind == KILN_ENVIRONMENT_CONSTANT) {
        memcpy(lights->environment_mean, e->radiance, sizeof e->radiance);
        lights->environment = kiln_luminance(e->radiance) > 0.0;
        return KILN_OK;
    }
    const uint32_t w = e->width, h = e->height;
    int status = kiln_allocate(&lights->marginal, h, sizeof *lights->marginal, "the environment's rows", error);
    if (status == KILN_OK)
        status = kiln_allocate(&lights->conditional, (size_t)w * h, sizeof *lights->conditional,
                               "the environment's distribution", error);
    if (status != KILN_OK)
        return status;
    double total = 0.0, sum[3] = {0};
    for (uint32_t y = 0; y < h; y++) {
        const double sine = row_sine(y, h);
        double row = 0.0;
        for (uint32_t x = 0; x < w; x++) {
            const float *t = texel_of(lights->scene, x, y);
            row += kiln_luminance(t) * sine;
            for (int c = 0; c < 3; c++)
                sum[c] += (double)t[c] * sine;
            lights->conditional[(size_t)y * w + x] = (float)row;
        }
        for (uint32_t x = 0; x < w; x++)
            lights->conditional[(size_t)y * w + x] =
                row > 0.0 ? (float)((double)lights->conditional[(size_t)y * w + x] / row) : (float)(x + 1) / (float)w;
        total += row;
        lights->marginal[y] = (float)total;
    }
    for (uint32_t y = 0; y < h; y++)
        lights->marginal[y] = total > 0.0 ? (float)((double)lights->marginal[y] / total) : (float)(y + 1) / (float)h;
    for (int c = 0; c < 3; c++) /* sum of sin = 2 h / pi a column */
        lights->environment_mean[c] = (float)(sum[c] * KILN_PI / (2.0 * (double)w * (double)h)) * e->radiance[c];
    lights->environment = kiln_luminance(lights->environment_mean) > 0.0;
    return KILN_OK;
}

static void texel_at(const struct kiln_environment *e, struct kiln_dvec3 d, uint32_t *x, uint32_t *y)
{
    double u = 0.5 + (atan2(d.x, -d.z) + (double)e->rotation) / (2.0 * KILN_PI);
    u -= floor(u);
    const double v = acos(fmax(-1.0, fmin(1.0, d.y))) / KILN_PI;
    *x = (uint32_t)fmin((double)e->width - 1.0, u * e->width);
    *y = (uint32_t)fmin((double)e->height - 1.0, v * e->height);
}

void kiln_environment_radiance(const struct kiln_lights *lights, struct kiln_dvec3 direction, float rgb[3])
{
    const struct kiln_environment *e = lights->scene->environment;
    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    if (!lights->environment)
        return;
    memcpy(rgb, e->radiance, 3 * sizeof *rgb);
    if (e->kind != KILN_ENVIRONMENT_LATLONG)
        return;
    uint32_t x, y;
    texel_at(e, direction, &x, &y);
    const float *t = texel_of(lights->scene, x, y);
    for (int c = 0; c < 3; c++)
        rgb[c] *= t[c];
}

/* First entry of a cumulative table above u; gives the place within it too. */
static uint32_t find_step(const float *cumulative, uint32_t count, double u, double *within)
{
    uint32_t low = 0, high = count - 1;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if ((double)cumulative[middle] > u)
            high = middle;
        else
            low = middle + 1;
    }
    const double begin = low == 0 ? 0.0 : (double)cumulative[low - 1], end = (double)cumulative[low];
    *within = end > begin ? fmin(1.0 - 1e-12, fmax(0.0, (u - begin) / (end - begin))) : 0.5;
    return low;
}

static double step_width(const float *cumulative, uint32_t index)
{
    return (double)cumulative[index] - (index == 0 ? 0.0 : (double)cumulative[index - 1]);
}

/* Density per steradian of texel (x, y): its chance over its solid angle. */
static double texel_density(const struct kiln_lights *lights, uint32_t x, uint32_t y)
{
    const struct kiln_environment *e = lights->scene->environment;
    const double chance = step_width(lights->marginal, y) * step_width(lights->conditional + (size_t)y * e->width, x);
    const double solid =
        (cos(KILN_PI * y / e->height) - cos(KILN_PI * (y + 1.0) / e->height)) * 2.0 * KILN_PI / e->width;
    return chance / solid;
}

struct kiln_dvec3 kiln_environment_sample(const struct kiln_lights *lights, double u, double v, double *density)
{
    const struct kiln_environment *e = lights->scene->environment;
    if (lights->conditional == NULL) {
        *density = 1.0 / (4.0 * KILN_PI);
        return kiln_sphere_direction(u, v);
    }
    double fy, fx;
    const uint32_t y = find_step(lights->marginal, e->height, v, &fy);
    const uint32_t x = find_step(lights->conditional + (size_t)y * e->width, e->width, u, &fx);
    *density = texel_density(lights, x, y);
    const double top = cos(KILN_PI * y / e->height), bottom = cos(KILN_PI * (y + 1.0) / e->height);
    const double height = top + (bottom - top) * fy, r = sqrt(fmax(0.0, 1.0 - height * height));
    const double phi = ((x + fx) / e->width - 0.5) * 2.0 * KILN_PI - (double)e->rotation;
    return dvec3(r * sin(phi), height, -r * cos(phi));
}

double kiln_environment_density(const struct kiln_lights *lights, struct kiln_dvec3 direction)
{
    if (lights->conditional == NULL)
        return 1.0 / (4.0 * KILN_PI);
    uint32_t x, y;
    texel_at(lights->scene->environment, direction, &x, &y);
    return texel_density(lights, x, y);
}
