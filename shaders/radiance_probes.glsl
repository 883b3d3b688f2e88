/* Radiance probes: as worker/scene/radiance_probes.h. */

#include "shaders/shared/harmonics.h"

layout(buffer_reference, scalar, buffer_reference_align = 8) readonly buffer ProbesRef {
    kiln_gpu_radiance_probes value;
};
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer ProbePositions { vec3 at[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer ProbeData { vec3 at[]; };

uint kiln_probe_cell(kiln_probe_grid grid, vec3 at)
{
    const uint x = kiln_probe_cell_along(at.x, grid.origin.x, grid.spacing, grid.size[0]),
               y = kiln_probe_cell_along(at.y, grid.origin.y, grid.spacing, grid.size[1]),
               z = kiln_probe_cell_along(at.z, grid.origin.z, grid.spacing, grid.size[2]);
    return (z * grid.size[1] + y) * grid.size[0] + x;
}

uint kiln_probe_draw(kiln_probe_grid grid, uint cell, uint corners, vec3 at, float u)
{
    const uint x = cell % grid.size[0], y = cell / grid.size[0] % grid.size[1],
               z = cell / (grid.size[0] * grid.size[1]);
    const vec3 place = vec3(kiln_probe_fraction(at.x, grid.origin.x, grid.spacing, x),
                            kiln_probe_fraction(at.y, grid.origin.y, grid.spacing, y),
                            kiln_probe_fraction(at.z, grid.origin.z, grid.spacing, z));
    const uint corner = kiln_probe_choose(corners, place, u);
    return cell + (corner & 1u) + ((corner >> 1 & 1u) + (corner >> 2 & 1u) * grid.size[1]) * grid.size[0];
}

vec3 kiln_probe_harmonics(ProbeData data, vec3 direction)
{
    const vec3 d = normalize(direction);
    vec3 sum = vec3(0.0);
#define KILN_ADD(index, y) sum += float(y) * data.at[index];
    KILN_HARMONICS_EACH(KILN_ADD, d)
#undef KILN_ADD
    return sum;
}

vec3 kiln_probe_ask(uint64_t address, uint probe, vec3 at, vec3 d, float far)
{
    const kiln_probe_grid grid = ProbesRef(address).value.grid;
    const vec3 to =
        kiln_probe_direction(grid, at, d, far, ProbePositions(ProbesRef(address).value.positions).at[probe]);
    ProbeData data = ProbeData(ProbesRef(address).value.data + uint64_t(probe) * grid.floats * 4ul);
    if (grid.basis == KILN_PROBE_HARMONICS)
        return kiln_probe_harmonics(data, to);
    return data.at[kiln_probe_element(grid.basis, grid.side, to)];
}

/* Whether the probe is visible from a point in free space. */
bool kiln_probe_seen(uint64_t address, uint probe, vec3 from)
{
    const vec3 position = ProbePositions(ProbesRef(address).value.positions).at[probe], to = position - from;
    const float distance = length(to);
    if (position.x >= KILN_PROBE_OFF || !(distance > 0.0))
        return false;
    const vec3 d = to / distance;
    const uvec3 o = floatBitsToUint(from), bits = floatBitsToUint(d);
    const uint seed = kiln_ray_bits_seed(o.x, o.y, o.z, bits.x, bits.y, bits.z);
    return !kiln_is_met(from, d, distance + KILN_PROBE_CLEAR * ProbesRef(address).value.grid.spacing, seed);
}

/* The probe that a ray without a hit within the range reads: one near its end that is visible from there, or else one
 * that the point, with the word `near_probes`, sees. */
uint kiln_probe_of_ray(uint64_t address, uint near_probes, vec3 at, vec3 d, uint ray_seed)
{
    const kiln_probe_grid grid = ProbesRef(address).value.grid;
    const uint choice = kiln_probe_choice(ray_seed);
    if (grid.range > 0.0) {
        const vec3 end = at + KILN_PROBE_END * grid.range * d;
        const uint probe = kiln_probe_draw(grid, kiln_probe_cell(grid, end), kiln_probe_corners(grid), end,
                                           kiln_unit_float(choice));
        if (kiln_probe_seen(address, probe, end))
            return probe;
    }
    return kiln_probe_draw(grid, near_probes >> KILN_PROBE_CORNERS, near_probes & KILN_PROBE_SEEN, at,
                           kiln_unit_float(kiln_hash1(choice)));
}
