#include "worker/scene/radiance_probes.h"

#include "worker/sampling/harmonics.h"

uint32_t kiln_probe_cell(const struct kiln_probe_grid *grid, struct kiln_vec3 at)
{
    const uint32_t x = kiln_probe_cell_along(at.x, grid->origin.x, grid->spacing, grid->size[0]),
                   y = kiln_probe_cell_along(at.y, grid->origin.y, grid->spacing, grid->size[1]),
                   z = kiln_probe_cell_along(at.z, grid->origin.z, grid->spacing, grid->size[2]);
    return (z * grid->size[1] + y) * grid->size[0] + x;
}

/* Sum of a probe's harmonics in direction d, of any length. */
static void sum_harmonics(const float *data, struct kiln_vec3 d, float radiance[3])
{
    double y[KILN_HARMONICS], sum[3] = {0.0, 0.0, 0.0};
    const struct kiln_dvec3 wide = dvec3_of(d);
    kiln_harmonics(dvec3_scale(wide, 1.0 / dvec3_length(wide)), y);
    for (int i = 0; i < KILN_HARMONICS; i++)
        for (int c = 0; c < 3; c++)
            sum[c] += y[i] * (double)data[3 * i + c];
    for (int c = 0; c < 3; c++)
        radiance[c] = (float)sum[c];
}

uint32_t kiln_probe_draw(const struct kiln_probe_grid *grid, uint32_t cell, uint32_t corners, struct kiln_vec3 at,
                         float u)
{
    const uint32_t x = cell % grid->size[0], y = cell / grid->size[0] % grid->size[1],
                   z = cell / (grid->size[0] * grid->size[1]);
    const struct kiln_vec3 place = vec3(kiln_probe_fraction(at.x, grid->origin.x, grid->spacing, x),
                                        kiln_probe_fraction(at.y, grid->origin.y, grid->spacing, y),
                                        kiln_probe_fraction(at.z, grid->origin.z, grid->spacing, z));
    return kiln_probe_at_corner(grid, cell, kiln_probe_choose(corners, place, u));
}

void kiln_probe_ask(const struct kiln_radiance_probes *probes, uint32_t probe, struct kiln_vec3 at, struct kiln_vec3 d,
                    float far, float radiance[3])
{
    const struct kiln_probe_grid *grid = &probes->grid;
    const float *data = probes->data + (size_t)probe * grid->floats;
    const struct kiln_vec3 to = kiln_probe_direction(*grid, at, d, far, probes->positions[probe]);
    if (grid->basis == KILN_PROBE_HARMONICS) {
        sum_harmonics(data, to, radiance);
        return;
    }
    const float *element = data + 3 * (size_t)kiln_probe_element(grid->basis, grid->side, to);
    for (int c = 0; c < 3; c++)
        radiance[c] = element[c];
}
