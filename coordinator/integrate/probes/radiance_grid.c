#include "coordinator/integrate/probes/radiance_grid.h"

#include <math.h>

#include "worker/sampling/harmonics.h"

/* auto: spacings along the longest side; elements along the side of an octahedral map, and of a cube map */
enum { PROBES_ALONG = 16, OCTAHEDRAL_SIDE = 8, CUBE_SIDE = 4 };
enum { HARMONICS_SIDE_LEAST = 4, HARMONICS_SIDE_MOST = 32, FINE = 16 /* places along an element for its integrals */ };

/* Returns the number of elements along a map's side. With harmonics the map is as fine as possible with one ray per
 * element. */
static uint32_t side_of(const struct kiln_radiance_settings *settings)
{
    if (settings->basis == (int)KILN_PROBE_HARMONICS) {
        const double side = floor(sqrt((double)settings->samples));
        return (uint32_t)fmin(fmax(side, HARMONICS_SIDE_LEAST), HARMONICS_SIDE_MOST);
    }
    if (settings->side > 0)
        return settings->side;
    return settings->basis == (int)KILN_PROBE_CUBE ? CUBE_SIDE : OCTAHEDRAL_SIDE;
}

static float component(struct kiln_vec3 v, int axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }

int kiln_probe_grid_make(struct kiln_probe_grid *grid, const struct kiln_radiance_settings *settings,
                         const struct kiln_geometry *geometry, struct kiln_error *error)
{
    const struct kiln_vec3 low = geometry->bounds_min, high = geometry->bounds_max, size = vec3_sub(high, low);
    const double longest = fmax((double)size.x, fmax((double)size.y, (double)size.z));
    const double automatic = longest > 0.0 ? longest / PROBES_ALONG : 1.0;
    const double spacing = settings->spacing > 0.0 ? settings->spacing : automatic;
    double origin[3], count[3];
    for (int a = 0; a < 3; a++) {
        count[a] = fmax(1.0, floor((double)component(size, a) / spacing + 0.5));
        origin[a] = 0.5 * ((double)component(low, a) + (double)component(high, a)) - 0.5 * (count[a] - 1.0) * spacing;
    }
    if (!(count[0] * count[1] * count[2] <= (double)KILN_PROBES_MOST))
        return kiln_fail(error, KILN_USAGE,
                         "a radiance probe every %g m would make more than %llu probes in a scene of %g x %g x %g m; "
                         "use a larger --radiance-probe-spacing",
                         spacing, (unsigned long long)KILN_PROBES_MOST, (double)size.x, (double)size.y, (double)size.z);
    const uint32_t side = side_of(settings), basis = (uint32_t)settings->basis;
    const uint32_t values = basis == KILN_PROBE_HARMONICS ? KILN_HARMONICS : kiln_probe_elements(basis, side);
    *grid = (struct kiln_probe_grid){.origin = vec3((float)origin[0], (float)origin[1], (float)origin[2]),
                                     .spacing = (float)spacing,
                                     .size = {(uint32_t)count[0], (uint32_t)count[1], (uint32_t)count[2]},
                                     .basis = basis,
                                     .side = side,
                                     .floats = 3 * values,
                                     .range = (float)settings->range,
                                     .projection = settings->approximate ? (float)longest : 0.0f,
                                     .low = low,
                                     .high = high};
    return KILN_OK;
}

uint32_t kiln_probe_element_samples(const struct kiln_probe_grid *grid, const struct kiln_radiance_settings *settings)
{
    const uint32_t elements = kiln_probe_elements(grid->basis, grid->side);
    return settings->samples > elements ? settings->samples / elements : 1;
}

struct kiln_vec3 kiln_probe_grid_position(const struct kiln_probe_grid *grid, uint64_t probe)
{
    const uint64_t x = probe % grid->size[0], y = probe / grid->size[0] % grid->size[1],
                   z = probe / ((uint64_t)grid->size[0] * grid->size[1]);
    return vec3(grid->origin.x + (float)x * grid->spacing, grid->origin.y + (float)y * grid->spacing,
                grid->origin.z + (float)z * grid->spacing);
}

/* The integrals over an element, by places spread evenly over it. */
static struct kiln_probe_element element_of(const struct kiln_probe_grid *grid, uint32_t number)
{
    struct kiln_probe_element element = {0};
    for (int i = 0; i < FINE * FINE; i++) {
        const float s = ((float)(i % FINE) + 0.5f) / FINE, t = ((float)(i / FINE) + 0.5f) / FINE;
        const struct kiln_dvec3 at = dvec3_of(kiln_probe_point(grid->basis, grid->side, number, s, t));
        const double scale = 1.0 / dvec3_length(at), weight = scale * scale * scale;
        double y[KILN_HARMONICS];
        kiln_harmonics(dvec3_scale(at, scale), y);
        element.solid_angle += weight;
        for (int h = 0; h < KILN_HARMONICS; h++)
            element.harmonics[h] += weight * y[h];
    }
    return element;
}

void kiln_probe_elements_make(const struct kiln_probe_grid *grid, struct kiln_probe_element *elements)
{
    const uint32_t count = kiln_probe_elements(grid->basis, grid->side);
    struct kiln_probe_element all = {0};
    for (uint32_t e = 0; e < count; e++) {
        elements[e] = element_of(grid, e);
        all.solid_angle += elements[e].solid_angle;
        for (int h = 1; h < KILN_HARMONICS; h++)
            all.harmonics[h] += elements[e].harmonics[h];
    }
    for (uint32_t e = 0; e < count; e++) {
        const double share = elements[e].solid_angle / all.solid_angle, unit = 4.0 * KILN_PI / all.solid_angle;
        elements[e].solid_angle = 4.0 * KILN_PI * share;
        elements[e].harmonics[0] *= unit;
        for (int h = 1; h < KILN_HARMONICS; h++)
            elements[e].harmonics[h] = unit * (elements[e].harmonics[h] - share * all.harmonics[h]);
    }
}

double kiln_probe_back_share(const struct kiln_probe_element *elements, const struct kiln_radiance_result *results,
                             uint32_t count)
{
    double share = 0.0;
    for (uint32_t e = 0; e < count; e++)
        share += elements[e].solid_angle / (4.0 * KILN_PI) * (double)results[e].back;
    return share;
}

void kiln_probe_keep(const struct kiln_probe_grid *grid, const struct kiln_probe_element *elements,
                     const struct kiln_radiance_result *results, float *data)
{
    const uint32_t count = kiln_probe_elements(grid->basis, grid->side);
    for (uint32_t e = 0; grid->basis != KILN_PROBE_HARMONICS && e < count; e++)
        for (int c = 0; c < 3; c++)
            data[3 * e + (uint32_t)c] = results[e].radiance[c];
    for (int i = 0; grid->basis == KILN_PROBE_HARMONICS && i < 3 * KILN_HARMONICS; i++) {
        double sum = 0.0;
        for (uint32_t e = 0; e < count; e++)
            sum += elements[e].harmonics[i / 3] * (double)results[e].radiance[i % 3];
        data[i] = (float)sum;
    }
}
