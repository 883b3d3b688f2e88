#include "worker/light/environment.h"

#include <math.h>
#include <string.h>

#include "worker/base/memory.h"
#include "worker/light/access.h"

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
        lights->environment = kiln_luminance_of_floats(e->radiance) > 0.0;
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
            row += kiln_luminance_of_floats(t) * sine;
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
    lights->environment = kiln_luminance_of_floats(lights->environment_mean) > 0.0;
    return KILN_OK;
}

void kiln_environment_texel(const struct kiln_lights *lights, struct kiln_dvec3 d, uint32_t *x, uint32_t *y)
{
    const struct kiln_environment *e = lights->scene->environment;
    *x = kiln_sky_column(d, (double)e->rotation, e->width);
    *y = kiln_sky_row(d, e->height);
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
    kiln_environment_texel(lights, direction, &x, &y);
    const float *t = texel_of(lights->scene, x, y);
    for (int c = 0; c < 3; c++)
        rgb[c] *= t[c];
}

double kiln_environment_texel_density(const struct kiln_lights *lights, uint32_t x, uint32_t y)
{
    return kiln_sky_texel_density(lights, x, y);
}

struct kiln_dvec3 kiln_environment_in_texel(const struct kiln_lights *lights, uint32_t x, uint32_t y, double fx,
                                            double fy)
{
    return kiln_sky_in_texel(lights, x, y, fx, fy);
}

struct kiln_dvec3 kiln_environment_sample(const struct kiln_lights *lights, double u, double v, double *density)
{
    return kiln_sky_sample(lights, u, v, density);
}

double kiln_environment_density(const struct kiln_lights *lights, struct kiln_dvec3 direction)
{
    return kiln_sky_direction_density(lights, direction);
}
